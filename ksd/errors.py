"""The typed errors a user can meet; each carries one clear sentence and a command-line exit code.

>>> [ksd.errors.SceneError.exit_code, ksd.errors.ConvergenceError.exit_code]
[2, 3]
"""

from __future__ import annotations


class KsdError(Exception):
    """Base of all errors of this package; `exit_code` is what the command line returns.

    >>> try:
    ...     ksd.load_scene("missing.toml")
    ... except ksd.KsdError as error:
    ...     print(f"exit code {error.exit_code}: {error}")
    exit code 2: scene file 'missing.toml' cannot be read: it does not exist; check the path.
    """

    exit_code = 1


class SceneError(KsdError, ValueError):
    """The description is wrong: names the joint, link or parameter, its value, and what is allowed.

    >>> ksd.Material(E=-200 * GPa, nu=0.3)
    Traceback (most recent call last):
        ...
    ksd.errors.SceneError: Material: E = -200000000000.0 Pa must be positive.
    """

    exit_code = 2


class SceneFileError(SceneError):
    """A scene file is wrong: `mistakes` holds a sentence for each of its mistakes, and the message all of them.

    >>> from pathlib import Path
    >>> size = Path("arm.toml").write_text("linkz = 3")
    >>> try:
    ...     ksd.load_scene("arm.toml")
    ... except ksd.SceneFileError as error:
    ...     print(error)
    arm.toml, line 1: key 'linkz' is unknown; did you mean "links"?
    """

    def __init__(self, message: str, *, mistakes: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.mistakes = mistakes or (message,)


class UnknownNameError(SceneError):
    """A link, joint or leaf, `name` of `kind`, does not exist.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> ksd.solve(guide, stroke).forces["tabel"]
    Traceback (most recent call last):
        ...
    ksd.errors.UnknownNameError: there is no drive 'tabel'; did you mean "table"?
    """

    def __init__(self, message: str, *, kind: str = "", name: str = "") -> None:
        super().__init__(message)
        self.kind, self.name = kind, name


class UnknownWordError(SceneError, AttributeError):
    """There is no method or attribute of this name; the message lists those there are.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> guide.actuat
    Traceback (most recent call last):
        ...
    ksd.errors.UnknownWordError: a mechanism has no 'actuat'; did you mean "actuate"?
    """


class ResumeError(SceneError):
    """The file of `resume=` cannot be written any more; what is in it is kept. It ends the search.

    >>> issubclass(ksd.ResumeError, ksd.KsdError), ksd.ResumeError.exit_code
    (True, 2)
    """


class SceneWarning(UserWarning):
    """A value of a scene is possible but probably not meant, or was corrected.

    >>> import warnings
    >>> warnings.simplefilter("error", ksd.SceneWarning)
    >>> guide, _, _ = ksd.load_scene("guide")
    >>> push = ksd.Cycloid(5 * mm, duration=20e-3)
    >>> ksd.simulate(guide, until="20 ms", dt="2 ms", drives={"table": push})
    Traceback (most recent call last):
        ...
    ksd.errors.SceneWarning: dt = 0.002 s is more than a tenth of the longest free period...
    """


class KinematicsError(SceneError):
    """The mechanism can move without any joint resisting, or its drives contradict each other.

    >>> pivot, _, _ = ksd.load_scene("pivot")
    >>> drive = pivot.actuate("lever", along="x", at=(200 * mm, 0, 0), name="push")
    >>> ksd.solve(pivot, turn=20 * deg, push=5 * mm, method="kinematic")
    Traceback (most recent call last):
        ...
    ksd.errors.KinematicsError: method 'kinematic' knows no force of 'push'...
    """


class RangeError(SceneError):
    """A stroke or shape parameter lies outside the trained range of a joint record.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> pivot = ksd.Mechanism.of_joint(ksd.CrossedPivot(
    ...     steel, length=50 * mm, angle=45 * deg, thickness=0.3 * mm, width=15 * mm
    ... ))
    >>> ksd.solve(pivot, angle=60 * deg, method="full")
    Traceback (most recent call last):
        ...
    ksd.errors.RangeError: joint 'joint' would turn 60 degrees, outside its trained range of -30 to 30 degrees...
    """


class ConvergenceError(KsdError):
    """A solve stopped before equilibrium; `reached` is the drive fraction solved, `result` the last state.

    >>> arm = ksd.Mechanism("arm", plane="xy")
    >>> pin = arm.pin("ground", arm.link("rod"), at=(0, 0, 0))
    >>> drive = arm.actuate("rod", along="x", at=(0, 20 * mm, 0), name="push")
    >>> try:
    ...     ksd.solve(arm, push=30 * mm)
    ... except ksd.ConvergenceError as stop:
    ...     print(f"stopped at {stop.reached:.0%}")
    stopped at 67%
    """

    exit_code = 3

    def __init__(self, message: str, *, reached: float = 0.0, result: object | None = None) -> None:
        super().__init__(message)
        self.reached = reached
        self.result = result


class TrustError(ConvergenceError):
    """A solve converged to a state that cannot be believed: unstable, or on another branch; `result` is that state.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> column = ksd.Mechanism("column", plane="xy")
    >>> leaf = column.leaf(
    ...     "ground", column.link("top"), start=(0, 0, 0), end=(0, 100 * mm, 0),
    ...     section=ksd.rectangle(1 * mm, 10 * mm), material=steel,
    ... )
    >>> load = column.load("top", force=(0, -100, 0), at=(0, 100 * mm, 0))
    >>> ksd.solve(column)
    Traceback (most recent call last):
        ...
    ksd.errors.TrustError: not to be trusted: UNSTABLE...
    """


class RecordError(KsdError):
    """A joint record is missing, truncated, altered, or of a format this version cannot read.

    >>> ksd.find_record("my_pivot")
    Traceback (most recent call last):
        ...
    ksd.errors.RecordError: No joint record of family 'my_pivot'...
    """

    exit_code = 4


DESIGN_ERRORS = (Exception,)
"""Errors by which a function of parameters refuses a design: any, as one design must not end a search for all others."""


def reason_text(error: BaseException) -> str:
    """The message of an error; with its type where it is none by itself, as that of a bare assert or of a missing key."""
    if isinstance(error, KeyError) and str(error):
        return f"{type(error).__name__}: {error}"
    return str(error) or type(error).__name__
