"""Libraries that only some functions and commands need, and that come with an extra of the package."""

import importlib
from typing import Any


def require(module: str, purpose: str, extra: str = "looking") -> Any:
    """Import and return a module, or raise a ValueError that says how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ValueError(
            f"{purpose} needs {module.split('.')[0]}, which cannot be imported ({error}); "
            f"pip install 'openmm-helfrich[{extra}]' brings it"
        ) from None


def dataFrame(data: Any) -> Any:
    """Return a pandas.DataFrame of columns or rows, or raise a ValueError that says how to get pandas."""
    return require("pandas", "a DataFrame", "analysis").DataFrame(data)
