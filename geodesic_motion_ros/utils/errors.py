"""Errors of the package: each message says what was wrong and what would have been right."""


class GeodesicMotionError(Exception):
    """Base of every error this package raises on purpose."""


class FileError(GeodesicMotionError):
    """A file is not of the kind, size or format that it should be."""


class DemonstrationError(GeodesicMotionError):
    """A recording cannot be used as demonstrations."""


class SkillError(GeodesicMotionError):
    """A skill folder is missing, damaged, or of another robot or format."""


class RobotError(GeodesicMotionError):
    """A robot description or a joint state does not fit."""


class PlanningError(GeodesicMotionError):
    """Something was requested of a planner that has no meaning."""


class ParameterError(GeodesicMotionError):
    """A parameter has the wrong type or lies outside its range."""


class ExperimentError(GeodesicMotionError):
    """Experiments of a series failed, while the others went on."""
