"""Speed for accuracy: the settings of a scene measured, and the cheapest that keeps within an error.

:mod:`.settings` says what can be traded, :mod:`.measure` measures one setting, :mod:`.search` goes through them, and
:mod:`.report` writes down what was found.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..files import PathLike
from ..io.locks import locked
from ..runs.config import Config, parseConfig, readConfig
from ..sampling.progress import requireProgress
from ..units import realNumber
from .report import recommendationText, tableText, writeReport
from .search import OutOfTime, Search, SearchPoint

__all__ = ["Search", "SearchPoint", "recommendationText", "tableText", "tradeoff", "writeReport"]


def tradeoff(
    config: Config | dict[str, Any] | PathLike,
    prefix: PathLike | None = None,
    error: float = 1e-3,
    effort: float = 3e8,
    minutes: float | None = None,
    axes: Sequence[str] | None = None,
    overwrite: bool = False,
    progress: Callable[[SearchPoint], None] | None = None,
) -> tuple[Search, SearchPoint | None]:
    """Measure the settings of a scene, and find the cheapest one that keeps within an error.

    The cost is the processor time, on one thread, to an independent sample of the lowest shape modes.  The search goes
    once through the axes, and from each with its best choice to the next. Each measurement is kept in PREFIX.json, from
    which a search that was stopped goes on.  For a seed all results are the same but for times, and choices that follow
    from them.

    Parameters
    ----------
    config : Config, dict or path
        the scene: what a run takes.  Its last stage must sample; the others are done first
    prefix : path
        of the files; by default the configuration's prefix and "_tradeoff"
    error : float
        the relative error of the averages of bending energy, area and volume that is allowed
    effort : float
        the largest number of force evaluations at a setting, times the number of vertices
    minutes : float, optional
        processor time after which no measurement is begun
    axes : list of str, optional
        the names of the axes to search; all by default
    overwrite : bool
        begin anew instead of going on with an earlier search
    progress : callable, optional
        called with the :class:`SearchPoint` before and after it is measured

    Returns
    -------
    Search, SearchPoint or None
        everything that was measured, and what is recommended: None if the time was spent before

    Raises
    ------
    ValueError, OSError, openmm.OpenMMException
        if an argument or the scene will not do, the files are those of another scene, or another search writes them
    """
    requireProgress(progress)
    if not 0 < realNumber(error, "tradeoff: the error") < 1:
        raise ValueError(f"tradeoff: the error is {error}; it must be between 0 and 1")
    if not realNumber(effort, "tradeoff: the effort") > 0:
        raise ValueError(f"tradeoff: the effort is {effort}; it must be positive")
    if minutes is not None:
        realNumber(minutes, "tradeoff: minutes")
    config = (
        config
        if isinstance(config, Config)
        else parseConfig(config)
        if isinstance(config, dict)
        else readConfig(config)
    )
    prefix = str(prefix or f"{config.output.prefix or 'scene'}_tradeoff")
    Path(prefix).parent.mkdir(parents=True, exist_ok=True)
    with locked(prefix):
        return _search(config, prefix, error, effort, minutes, axes, overwrite, progress)


def _search(
    config: Config,
    prefix: str,
    error: float,
    effort: float,
    minutes: float | None,
    axes: Sequence[str] | None,
    overwrite: bool,
    progress: Callable[[SearchPoint], None] | None,
) -> tuple[Search, SearchPoint | None]:
    """Go on with a search, or begin one, and write down what it found."""
    if overwrite:
        for ending in (".json", "_start.ply", "_start.json", "_coarse.ply", "_coarse.json"):
            Path(prefix + ending).unlink(missing_ok=True)
    search = Search(config, prefix, error, effort, minutes, axes, progress)
    try:
        recommended = search.run()
    except OutOfTime:
        recommended = None
    if len(search.points) > 1:
        writeReport(search, prefix, recommended)
    return search, recommended
