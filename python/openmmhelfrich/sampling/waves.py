"""L-BFGS with the stiffness of a membrane's waves, so that long waves take as few iterations as short ones."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

# The stiffness of a membrane against motions in its plane, in bending moduli and mean edge lengths, and the least
# cotangent, which keeps that of bending positive.
_IN_PLANE, _LEAST_COTANGENT = 10.0, 0.05
# The number of pairs of steps and changes of slopes that are kept, the iterations between two stiffnesses, the
# farthest step of a vertex in mean edge lengths, and the most trials of a line search.
_MEMORY, _RENEWAL, _FARTHEST, _TRIALS = 20, 25, 0.3, 30
# A descent ends where the iterations with one stiffness lower the energy by no more than this part, as rounding does.
_ROUNDING = 1e-12
# A step lowers the energy by this part of what the slope promises, and leaves no more than that part of the slope.
_DECREASE, _SLOPE = 1e-4, 0.9

Evaluation = Callable[[np.ndarray], tuple[float, np.ndarray]]
Apply = Callable[[np.ndarray], np.ndarray]


class WaveStiffness:
    """The inverse of an approximate second derivative of a membrane's energy.

    Along normals a membrane resists by its bending modulus, kappa q^4 of a wave number q, and by its tension, sigma
    q^2; in its plane by a tether, of which no more is known than that it has neighbors move together, as q^2; and as a
    whole by its penalties, with a rank of one each (Sherman-Morrison-Woodbury).

    Parameters
    ----------
    sides : (T, 3, 3) array
        the vectors along the sides of triangles, from each corner to the next
    triangles : (T, 3) array of int
        numbers of vertices
    isFixed : (N,) array of bool
        vertices that do not move
    bendingModulus, tension : float
        kappa and sigma
    penalties : list of (N, 3) arrays
        slopes whose products with themselves are the second derivatives of penalties
    rigid : sequence of (N, 3) arrays
        motions of whole surfaces, which only other forces resist, of about a unit of energy
    """

    def __init__(
        self,
        sides: np.ndarray,
        triangles: np.ndarray,
        isFixed: np.ndarray,
        bendingModulus: float,
        tension: float,
        penalties: list[np.ndarray],
        rigid: Sequence[np.ndarray] = (),
    ) -> None:
        n, self._rigid = len(isFixed), rigid
        cross = np.cross(sides[:, 0], sides[:, 1])
        twice = np.maximum(np.linalg.norm(cross, axis=1), 1e-12 * np.max(sides**2))
        self._isMoving = ~isFixed[:, np.newaxis]
        normals = np.stack([np.bincount(triangles.ravel(), np.repeat(cross[:, k], 3), n) for k in range(3)], axis=1)
        self._normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        areas = np.bincount(triangles.ravel(), np.repeat(twice / 6, 3), n)
        isAlone = areas == 0
        areas[isAlone] = areas[~isAlone].mean()
        laplacian = _laplacian(sides, twice, triangles, n) + sparse.diags(isAlone.astype(float))
        laplacian = laplacian + 4 * np.pi / areas.sum() * sparse.diags(areas)
        self._bending = _factors(bendingModulus * laplacian @ sparse.diags(1 / areas) @ laplacian + tension * laplacian)
        length = np.linalg.norm(sides, axis=2).mean()
        self._inPlane = _factors(_IN_PLANE * bendingModulus / length**2 * laplacian)
        columns, shape = [self._alone(slopes) for slopes in penalties], (len(penalties), 3 * n)
        self._columns, slopes = np.reshape(columns, shape).T, np.reshape(penalties, shape).T
        self._inner = np.linalg.inv(np.identity(len(penalties)) + slopes.T @ self._columns)

    def __call__(self, slopes: np.ndarray) -> np.ndarray:
        """Return the motion, an (N, 3) array, that (N, 3) slopes ask for."""
        less = self._columns @ (self._inner @ (self._columns.T @ slopes.ravel()))
        return self._alone(slopes) - less.reshape(-1, 3)

    def _alone(self, slopes: np.ndarray) -> np.ndarray:
        """Return the motion without penalties."""
        slopes = np.where(self._isMoving, slopes, 0)
        along = np.sum(slopes * self._normals, axis=1)
        across = self._inPlane.solve(slopes - along[:, np.newaxis] * self._normals)
        change = self._bending.solve(along) - np.sum(across * self._normals, axis=1)
        motion = across + change[:, np.newaxis] * self._normals
        for whole in self._rigid:
            motion = motion + np.vdot(whole, slopes) * whole
        return np.where(self._isMoving, motion, 0)


def _laplacian(sides: np.ndarray, twice: np.ndarray, triangles: np.ndarray, n: int) -> sparse.csr_matrix:
    """Return the cotangent Laplacian, positive, from the sides and twice the areas of triangles."""
    weights = sparse.csr_matrix((n, n))
    for k in range(3):
        cotangent = -np.sum(sides[:, k - 2] * sides[:, k - 1], axis=1) / twice
        half = 0.5 * np.maximum(cotangent, _LEAST_COTANGENT)
        weights = weights + sparse.coo_matrix((half, (triangles[:, k], triangles[:, k - 2])), (n, n)).tocsr()
    weights = weights + weights.T
    return sparse.diags(np.asarray(weights.sum(axis=1)).ravel()) - weights


def _factors(matrix: sparse.csr_matrix) -> SuperLU:
    """Return the factors of a symmetric, positive matrix."""
    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def descend(
    evaluate: Evaluation,
    start: np.ndarray,
    stiffnessAt: Callable[[np.ndarray], Apply],
    length: float,
    report: Callable[[np.ndarray, float, np.ndarray], bool],
    iterations: int = 0,
    pairs: list[tuple[np.ndarray, np.ndarray]] | None = None,
) -> None:
    """Minimize by L-BFGS (Nocedal, Math. Comp. 35, 773, 1980), until it is told to end or finds no lower energy.

    Parameters
    ----------
    evaluate : callable
        returns the energy at (N, 3) positions, which may be infinite, and its slopes
    start : (N, 3) array
        the positions at the start
    stiffnessAt : callable
        returns the inverse second derivative that is the guess at some positions
    length : float
        the mean length of edges
    report : callable
        called after each iteration with positions, energy and slopes; returns whether to end
    iterations : int
        the number at which to end, or 0 for no limit
    pairs : list, optional
        the steps and changes of slopes of a descent before this one, to which those of this one are added
    """
    x, (energy, slopes) = start, evaluate(start)
    pairs = [] if pairs is None else pairs
    count, age = 0, 0
    stiffness, before = stiffnessAt(x), energy
    while not iterations or count < iterations:
        if age == _RENEWAL:
            if before - energy <= _ROUNDING * abs(energy):
                return
            stiffness, age, before = stiffnessAt(x), 0, energy
        direction = -_twoLoops(pairs, slopes, stiffness)
        found = _search(evaluate, x, energy, slopes, direction, length)
        if found is None:
            if not pairs:
                return
            pairs.clear()
            continue
        step, energy, after = found
        change, x, slopes = after - slopes, x + step, after
        if np.vdot(step, change) > 1e-10 * np.linalg.norm(step) * np.linalg.norm(change):
            pairs.append((step, change))
            del pairs[:-_MEMORY]
        count, age = count + 1, age + 1
        if report(x, energy, slopes):
            return


def _twoLoops(pairs: list[tuple[np.ndarray, np.ndarray]], slopes: np.ndarray, stiffness: Apply) -> np.ndarray:
    """Return the product of the inverse second derivative of L-BFGS with slopes."""
    rest, parts = slopes, []
    for step, change in pairs[::-1]:
        parts.append(np.vdot(step, rest) / np.vdot(step, change))
        rest = rest - parts[-1] * change
    motion = stiffness(rest)
    if pairs:
        step, change = pairs[-1]
        motion *= np.clip(np.vdot(step, change) / np.vdot(change, stiffness(change)), 1e-3, 1e3)
    for (step, change), part in zip(pairs, parts[::-1]):
        motion = motion + (part - np.vdot(change, motion) / np.vdot(step, change)) * step
    return motion


def _search(
    evaluate: Evaluation, x: np.ndarray, energy: float, slopes: np.ndarray, direction: np.ndarray, length: float
) -> tuple[np.ndarray, float, np.ndarray] | None:
    """Return a step along a direction that holds to the conditions of Wolfe, with the energy and slopes after it."""
    slope, farthest = float(np.vdot(direction, slopes)), float(np.abs(direction).max())
    if not slope < 0:
        return None
    longest = _FARTHEST * length / farthest
    low, high, best = 0.0, np.inf, None
    part = min(1.0, longest)
    for _ in range(_TRIALS):
        after, slopesAfter = evaluate(x + part * direction)
        if not after <= energy + _DECREASE * part * slope:
            high = part
            guess = -slope * part**2 / (2 * (after - energy - slope * part)) if np.isfinite(after) else 0.1 * part
            part = min(max(guess, 0.1 * part), 0.5 * part) if low == 0 else 0.5 * (low + high)
            continue
        best = part * direction, after, slopesAfter
        if np.vdot(direction, slopesAfter) >= _SLOPE * slope or part == longest:
            break
        low = part
        part = min(2 * part, longest) if high == np.inf else 0.5 * (low + high)
    return best
