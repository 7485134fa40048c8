"""The typed errors a user can meet; each carries one clear sentence and a command-line exit code."""

from __future__ import annotations


class KsdError(Exception):
    """Base of all errors of this package; `exit_code` is what the command line returns."""

    exit_code = 1


class SceneError(KsdError, ValueError):
    """The description is wrong: names the joint, link or parameter, its value, and what is allowed."""

    exit_code = 2


class SceneFileError(SceneError):
    """A scene file is wrong: `mistakes` holds a sentence for each of its mistakes, and the message all of them."""

    def __init__(self, message: str, *, mistakes: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.mistakes = mistakes or (message,)


class UnknownNameError(SceneError):
    """A link, joint or leaf, `name` of `kind`, does not exist."""

    def __init__(self, message: str, *, kind: str = "", name: str = "") -> None:
        super().__init__(message)
        self.kind, self.name = kind, name


class UnknownWordError(SceneError, AttributeError):
    """There is no method or attribute of this name; the message lists those there are."""


class ResumeError(SceneError):
    """The file of `resume=` cannot be written any more; what is in it is kept. It ends the search."""


class SceneWarning(UserWarning):
    """A value of a scene is possible but probably not meant, or was corrected."""


class KinematicsError(SceneError):
    """The mechanism can move without any joint resisting, or its drives contradict each other."""


class RangeError(SceneError):
    """A stroke or shape parameter lies outside the trained range of a joint record."""


class ConvergenceError(KsdError):
    """A solve stopped before equilibrium; `reached` is the drive fraction solved, `result` the last state."""

    exit_code = 3

    def __init__(self, message: str, *, reached: float = 0.0, result: object | None = None) -> None:
        super().__init__(message)
        self.reached = reached
        self.result = result


class TrustError(ConvergenceError):
    """A solve converged to a state that cannot be believed: unstable, or on another branch; `result` is that state."""


class RecordError(KsdError):
    """A joint record is missing, truncated, altered, or of a format this version cannot read."""

    exit_code = 4


DESIGN_ERRORS = (Exception,)
"""Errors by which a function of parameters refuses a design: any, as one design must not end a search for all others."""


def reason_text(error: BaseException) -> str:
    """The message of an error; with its type where it is none by itself, as that of a bare assert or of a missing key."""
    if isinstance(error, KeyError) and str(error):
        return f"{type(error).__name__}: {error}"
    return str(error) or type(error).__name__
