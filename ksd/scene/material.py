"""Elastic material of a leaf."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ksd.checks import ClearArgumentErrors, between, number, positive, show
from ksd.errors import SceneError


@dataclass(frozen=True, init=False)
class Material(metaclass=ClearArgumentErrors):
    """Linear elastic material, by two of Young's modulus E, shear modulus G [Pa] and Poisson's ratio nu.

    The third follows from E = 2 G (1 + nu); any positive pair of E and G is accepted (an anisotropic leaf). density
    [kg/m^3]: needed for masses and weight; expansion [1/K]: linear thermal expansion, needed for temperatures.
    loss_factor: damping of free vibrations, twice the damping ratio of a leaf spring of it; from 0 to 1. yield_stress,
    fatigue_limit [Pa]: strength once, and for unlimited cycles; answers then report stresses as shares of
    them, and nothing else depends on them. name: shown in messages.

    Raises SceneError for a modulus, density or limit that is not positive and finite, nu outside (-1, 0.5], fewer than two
    of the three, or three that contradict each other by more than 1e-3.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, yield_stress=900e6)
    >>> print(f"G = {steel.G / GPa:.2f} GPa")
    G = 76.92 GPa
    """

    E: float
    G: float
    nu: float = field(compare=False)
    density: float | None
    name: str
    expansion: float | None
    yield_stress: float | None
    fatigue_limit: float | None
    loss_factor: float | None

    def __init__(
        self,
        E: float | None = None,
        *,
        G: float | None = None,
        nu: float | None = None,
        density: float | None = None,
        name: str = "",
        expansion: float | None = None,
        yield_stress: float | None = None,
        fatigue_limit: float | None = None,
        loss_factor: float | None = None,
    ) -> None:
        if not isinstance(name, str):
            raise SceneError(f"Material: name = {show(name)} must be text.")
        owner = f"Material '{name}'" if name else "Material"
        E = None if E is None else positive(E, "E", owner=owner, unit="Pa")
        G = None if G is None else positive(G, "G", owner=owner, unit="Pa")
        if nu is not None:
            nu = between(nu, "nu (Poisson's ratio)", -1.0, 0.5 + 1e-12, owner=owner)
        E, G, nu = _complete(E, G, nu, owner)
        if density is not None:
            density = positive(density, "density", owner=owner, unit="kg/m^3")
        if expansion is not None:
            expansion = number(expansion, "expansion", owner=owner, unit="1/K")
        if loss_factor is not None:
            loss_factor = between(loss_factor, "loss_factor", 0.0, 1.0, owner=owner)
        limits = {"yield_stress": yield_stress, "fatigue_limit": fatigue_limit}
        for key, limit in limits.items():
            limits[key] = None if limit is None else positive(limit, key, owner=owner, unit="Pa")
        self.__dict__.update(
            limits, E=E, G=G, nu=nu, density=density, name=name, expansion=expansion, loss_factor=loss_factor
        )

    def without_mass(self) -> Material:
        """The material without density."""
        return replace(self, density=None)


def _complete(E: float | None, G: float | None, nu: float | None, owner: str) -> tuple[float, float, float]:
    """E, G, nu from any two of them. Raises SceneError."""
    if E is not None and G is not None:
        if nu is not None and abs(E - 2 * G * (1 + nu)) > 1e-3 * E:
            raise SceneError(
                f"{owner}: E = {E:g} Pa, G = {G:g} Pa and nu = {nu:g} contradict "
                "E = 2 G (1 + nu); give two of them."
            )
        return E, G, E / (2 * G) - 1 if nu is None else nu
    if nu is not None and E is not None:
        return E, E / (2 * (1 + nu)), nu
    if nu is not None and G is not None:
        return 2 * G * (1 + nu), G, nu
    given = [k for k, v in (("E", E), ("G", G), ("nu", nu)) if v is not None]
    raise SceneError(f"{owner}: give two of E, G and nu; {f'only {given[0]}' if given else 'none'} is given.")
