"""The settings of both trainings; light, so that what only names them need not load torch."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_ros.utils.checked_numbers import LARGEST_DIMENSION, ROUND_DIMENSIONS, SMALLEST_SCALE
from geodesic_motion_ros.utils.errors import ParameterError

if TYPE_CHECKING:
    from geodesic_motion_ros.learning.autoencoder import OrientationModel

#: The paper has no term of the joints alone; so little is none, and keeps every tensor positive [m].
_NO_JOINT_WEIGHT = 1e-6
#: Of positions and orientations, in the paper.
_PAPER_DENSITIES = "diagonal", "von_mises_fisher"
#: Numbers that may be 0; all others are positive.
_MAY_BE_ZERO = {
    "seed", "progress_share", "blends", "kl_weight", "kl_warm_up", "margin", "metric.sigma_weight",
    "metric.progress_length",
}  # fmt: skip
_POSES_MAY_BE_ZERO = _MAY_BE_ZERO | {
    "orientation_weight", "rotation_length", "position_resolution", "angular_resolution",
}  # fmt: skip
_CONFIGURATIONS_MAY_BE_ZERO = _MAY_BE_ZERO | {
    "volume_weight", "body_sigma", "joint_resolution", "metric.orientation_weight",
}  # fmt: skip


@dataclass(frozen=True)
class CommonSettings:
    """Settings that the trainings of both output spaces have.

    Attributes
    ----------
    seed : of everything random: initial weights, batches, latent noise, k-means.
    sheet : "canonical" (endpoint-normalised: start and goal offsets taken out before) or "raw" (the paper's).
    schedule : "two_stage" or "joint" (the paper's: means and deviations together, after a first half of the steps in
        which the codes settle so that kernels can be placed on them).
    latent_dimension : d, 1 to 6; from 4 on the nodes of the skill's graph are sampled.
    hidden : units of the encoder's two hidden layers; the decoder has them in reverse.
    samples : per demonstration that are trained on, equally spaced along its arc.
    steps, batch, learning_rate : Adam steps with cosine decay, samples per step, initial rate.
    kl_weight, kl_warm_up : weight of the divergence in the evidence lower bound (the paper: 1), and the fraction of the
        steps over which it grows from 0. None: 0.6 on the canonical sheet, of rounds 0.3, and 0.3 on the raw one.
    progress_deviation : of the canonical sheet's prior along the strip.
    progress_share : of the mean length of the demonstrations that the whole of the progress counts in the metric of the
        canonical sheet.
    blends : random convex combinations of canonical demonstrations of one mode that are learned besides each. They
        fill the sheet between the demonstrations: sigma is as small there as on them.
    fixed_sigma : likelihood scale of coordinates while the means are learned [m] or [rad].
    kernels : radial-basis kernels, at most; never more than one for two codes.
    bandwidth_factor : kernel bandwidth over the median distance between neighbouring centres; the paper states none.
    precision_samples, precision_iterations : latent draws per sample that deviations are fitted on, and at most so many
        steps of L-BFGS.
    far_sigma : deviation far from all data [m] or [rad]: the height of the walls, of high ones as its square. The paper
        states none.
    margin : free border of the latent box around the codes, as a fraction of its size.
    closed : whether demonstrations are rounds, each of which ends where it began: their sheet is a cylinder.
    """

    seed: int = 0
    sheet: Literal["canonical", "raw"] = "canonical"
    schedule: Literal["two_stage", "joint"] = "two_stage"
    latent_dimension: int = 2
    hidden: tuple[int, int] = (200, 100)
    samples: int = 200
    steps: int = 5000
    batch: int = 256
    learning_rate: float = 2e-3
    kl_weight: float | None = None
    kl_warm_up: float = 0.2
    progress_deviation: float = 0.2
    progress_share: float = 0.25
    blends: int = 2
    fixed_sigma: float = 0.005
    kernels: int = 500
    bandwidth_factor: float = 1.0
    precision_samples: int = 4
    precision_iterations: int = 200
    far_sigma: float = 1.0
    margin: float = 0.05
    closed: bool = False

    @property
    def progress_numbers(self) -> int:
        """How many numbers the encoder reads, and the decoder decodes, of how far along its demonstration a sample is:
        on the canonical sheet s, of rounds cosine and sine of 2 pi s; none on the raw one.
        """
        return 0 if self.sheet == "raw" else 1 + self.closed

    def _choose_by_sheet(self, **choices: tuple[Any, Any]) -> None:
        """Replace what is None by what suits the sheet: choices are (of the canonical one, of the raw one)."""
        for name, (canonical, raw) in {"kl_weight": (0.3 if self.closed else 0.6, 0.3), **choices}.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, canonical if self.sheet == "canonical" else raw)

    def _check_choices(self, **choices: tuple[str, ...]) -> None:
        for name, allowed in {"sheet": ("canonical", "raw"), "schedule": ("two_stage", "joint"), **choices}.items():
            if getattr(self, name) not in allowed:
                raise ParameterError(f"{name} is {getattr(self, name)!r}; it must be one of {', '.join(allowed)}")
        if self.closed and self.sheet == "raw":
            raise ParameterError(
                "rounds are learned on the canonical sheet: choose that, or learn no rounds (closed False, --no-closed)"
            )
        if self.closed and self.latent_dimension not in ROUND_DIMENSIONS:
            raise ParameterError(f"latent_dimension is {self.latent_dimension}; rounds are learned in 2 or 3")


@dataclass(frozen=True)
class TrainingSettings(CommonSettings):
    """Settings of the training of a skill of tool poses.

    Kernels, bandwidth, weights of sigma and kappa and the two stages were chosen by measuring on real recordings of
    pouring and shelving; `rotation_length` and the two resolutions are judgement.

    Attributes
    ----------
    latent_dimension : d, 2 or 3.
    orientation_model : "two_cluster" (one von Mises-Fisher density; q and -q in separate clusters, on the raw sheet
        only) or "sign_blind": one code for both, on the raw sheet by the paper's antipodal mixture, on the canonical
        one by signs that agree. None: sign_blind on the canonical sheet, two_cluster on the raw one.
    rotation_length : length that a turn of one radian counts in the arc [m]: a tool that turns on the spot is learned
        too. 0 counts positions only.
    position_density : covariance of positions, "diagonal" or "full" (`manifold.full_covariance`).
    orientation_density : "von_mises_fisher", as wide about every axis, or "angular_central_gaussian", with a
        concentration about each of the tool's. The means are learned by the former in any case: the latter is blind to
        the sign. Both other densities need the schedule "two_stage".
    position_weight, orientation_weight : beta1, beta2 of the bound beta1 log p(x | z) + beta2 log p(q | z) - kl_weight
        KL.
    fixed_kappa : likelihood scale of orientations while the means are learned.
    far_kappa : concentration far from all data. The paper states none.
    position_resolution, angular_resolution : what a demonstration cannot be more exact than [m], [rad of
        rotation]; added to the residuals, so that a coordinate that never varies (a plane) keeps a finite
        precision. The paper has none: 0.
    metric : weights of the skill's metric; they take no part in the training.
    """

    orientation_model: OrientationModel | None = None
    rotation_length: float = 0.1
    position_density: Literal["diagonal", "full"] = "diagonal"
    orientation_density: Literal["von_mises_fisher", "angular_central_gaussian"] = "von_mises_fisher"
    position_weight: float = 1.0
    orientation_weight: float = 1.0
    fixed_kappa: float = 1600.0
    far_kappa: float = 0.01
    position_resolution: float = 0.001
    angular_resolution: float = 0.01
    metric: MetricSettings = field(default_factory=MetricSettings)

    @classmethod
    def paper(cls, **changes: Any) -> TrainingSettings:
        """The paper's model (section 3.1, learning in task space), with changes: nothing is taken out of the
        demonstrations, the mixture of q and -q, the evidence lower bound alone, all networks learned together, sigma
        and kappa as they are in the metric. Floors and width of the kernels, which it does not state, are ours.
        """
        literal = {
            "sheet": "raw", "orientation_model": "sign_blind", "schedule": "joint",
            "kl_weight": 1.0, "kl_warm_up": 0.0, "position_resolution": 0.0, "angular_resolution": 0.0,
            "bandwidth_factor": 1.0, "far_sigma": 1.0, "far_kappa": 0.01,
            "metric": MetricSettings(sigma_weight=1.0, orientation_scale="kappa"),
        }  # fmt: skip
        return cls(**(literal | changes))

    def __post_init__(self) -> None:
        self._choose_by_sheet(orientation_model=("sign_blind", "two_cluster"))
        self._check_choices(
            orientation_model=("two_cluster", "sign_blind"), position_density=("diagonal", "full"),
            orientation_density=("von_mises_fisher", "angular_central_gaussian"),
        )  # fmt: skip
        if self.schedule == "joint" and (self.position_density, self.orientation_density) != _PAPER_DENSITIES:
            raise ParameterError(f"schedule joint learns {' and '.join(_PAPER_DENSITIES)} densities alone")
        if self.sheet == "canonical" and self.orientation_model != "sign_blind":
            raise ParameterError(
                "a canonical sheet has no clusters of q and -q: choose orientation_model sign_blind, or sheet raw"
            )
        _check_dimension(self.latent_dimension)
        check_settings(self, self.hidden, self.metric, _POSES_MAY_BE_ZERO)
        if not SMALLEST_SCALE <= self.far_kappa < self.fixed_kappa:
            raise ParameterError(
                f"far_kappa is {self.far_kappa:g}; it must be from {SMALLEST_SCALE:g} to less than fixed_kappa, "
                f"{self.fixed_kappa:g}"
            )


@dataclass(frozen=True)
class JointTrainingSettings(CommonSettings):
    """Settings of the training of a skill of configurations.

    Attributes
    ----------
    volume_weight : of the change of variables to the body's configurations, log p(theta | z) - volume_weight log V. The
        paper's is 1. Beside body_sigma's term, with sigma fixed, on the canonical sheet it was measured to change next
        to nothing but the time; the default leaves it out.
    body_sigma : likelihood scale of the body's points, through the forward kinematics [m]. What a joint's error does to
        the tool depends on the joint and the posture; without this term, the paper has none, the tool is off by more. 0
        leaves it out.
    bandwidth_factor : in three dimensions kernels stand along thin strips, closer than the nodes of the grid: as wide
        as that distance the support would fall to pieces.
    joint_density : "gaussian", or "wrapped", the same for angles that whole turns separate: for joints without limits.
    joint_resolution : what a demonstration cannot be more exact than [rad]; added to the residuals. The paper has none:
        0.
    metric : weights of the skill's metric; they take no part in the training.
    """

    latent_dimension: int = 3
    volume_weight: float = 0.0
    fixed_sigma: float = 0.05
    body_sigma: float = 0.003
    bandwidth_factor: float = 2.0
    joint_density: Literal["gaussian", "wrapped"] = "gaussian"
    joint_resolution: float = 0.002
    metric: JointMetricSettings = field(default_factory=JointMetricSettings)

    @classmethod
    def paper(cls, **changes: Any) -> JointTrainingSettings:
        """The paper's model (section 3.2, learning in joint space), with changes: nothing is taken out of the
        demonstrations, the change of variables to the body in the evidence lower bound without weights, both networks
        learned together, sigma and the tool's orientation as they are in the metric. Floor and width of the kernels,
        which it does not state, the warm-up of the divergence and `joint_resolution` are ours.
        """
        literal = {
            "sheet": "raw", "schedule": "joint", "kl_weight": 1.0, "volume_weight": 1.0, "body_sigma": 0.0,
            "bandwidth_factor": 2.0, "far_sigma": 1.0,
            "metric": JointMetricSettings(sigma_weight=1.0, joint_weight=_NO_JOINT_WEIGHT, orientation_weight=1.0),
        }  # fmt: skip
        return cls(**(literal | changes))

    def __post_init__(self) -> None:
        self._choose_by_sheet()
        self._check_choices(joint_density=("gaussian", "wrapped"))
        _check_dimension(self.latent_dimension)
        check_settings(self, self.hidden, self.metric, _CONFIGURATIONS_MAY_BE_ZERO)


def _check_dimension(dimension: int) -> None:
    if not 1 <= dimension <= LARGEST_DIMENSION:
        raise ParameterError(f"latent_dimension is {dimension}; a latent space has 1 to {LARGEST_DIMENSION}")


def check_settings(settings: Any, hidden: tuple[int, ...], metric: Any, may_be_zero: Collection[str]) -> None:
    """Refuse settings of a training that no skill comes of: ParameterError names them.

    settings, metric : dataclasses; their numbers must be finite and positive, or 0 where `may_be_zero` names them,
    those of the metric as `metric.NAME`. hidden : units of the hidden layers.
    """
    if len(hidden) != 2:
        raise ParameterError(f"hidden has {len(hidden)} layers; the decoder format has exactly 2")
    numbers = asdict(settings) | {f"metric.{name}": value for name, value in asdict(metric).items()}
    wrong = [
        name for name, value in numbers.items()
        if type(value) in (int, float) and not (0.0 < value < math.inf or (value == 0.0 and name in may_be_zero))
    ]  # fmt: skip
    if wrong:
        raise ParameterError(f"training settings must be positive and finite: {', '.join(wrong)}")
    if not settings.fixed_sigma < settings.far_sigma <= 1.0 / SMALLEST_SCALE:
        raise ParameterError(
            f"far_sigma is {settings.far_sigma:g}; it must be more than fixed_sigma, {settings.fixed_sigma:g}, "
            f"and at most {1.0 / SMALLEST_SCALE:g}"
        )
