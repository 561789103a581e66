"""Records of the arguments that functions of ``import spinfilters`` and commands have in common.

Nothing heavy is imported here, so that help is quick. Those of a simulation are the fields of a
`spinfilters.simulation.scenario_record.Scenario`.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Final, Literal

from spinfilters.io.stated_values import Argument, ArgumentGroup, NumberRange
from spinfilters.simulation.scenario_record import Scenario

if TYPE_CHECKING:
    from spinfilters.io.reference_motion import ReferenceMotion
    from spinfilters.run.optional_outputs import OptionalOutputs

SEGMENT: Final = NumberRange(0, 10**9 - 1, whole=True)
MOTION: Final = ("epochs", "interval", "rate_rpm", "principal_moments")
"""Fields of a scenario that are the motion alone."""


@dataclass(frozen=True, kw_only=True)
class RunArguments:
    """What a comparison writes, where it goes on and how it is judged; of `compare`, and of the command and ``estimate``."""

    resume: Annotated[
        bool,
        Argument(
            "continue an interrupted run in RUN, to the same numbers; a finished run gets missing outputs"
        ),
    ] = False
    predict: Annotated[
        float | None,
        NumberRange(1e-9, 1e9, "s"),
        Argument(
            "predict so long after the last epoch: <estimator>/prediction.csv and .npz, prediction.png",
            metavar="SECONDS",
        ),
    ] = None
    convergence: Annotated[
        bool,
        Argument(
            "show how the smoother converges on tracks without a map: convergence.png, smoother/convergence.npz"
        ),
    ] = False
    explain: Annotated[
        bool,
        Argument("run again with each named model error that the state can include: explanations.json"),
    ] = False

    reference: Annotated[
        str | None,
        Argument(
            "another instrument's poses, attitudes or rates of the body (any recording that compare reads), on its own clock and "
            "in its own axes: reference.json, reference.npz, reference-<estimator>.png, reference-differences-<estimator>.png",
            metavar="FILE",
        ),
    ] = None
    reference_shares: Annotated[
        tuple[str, ...],
        Argument(
            "do not fit these of --reference: frame (its inertial frame is that of the data set), origin (it is the centre of "
            "mass)",
            metavar="frame,origin",
            cure='"frame", "origin" or "frame,origin"',
        ),
    ] = ()
    reference_inspector: Annotated[
        str | None,
        Argument(
            "poses of the inspector from the same instrument; --reference is then relative to it",
            metavar="FILE",
        ),
    ] = None

    race: Annotated[
        tuple[str, ...],
        Argument(
            "with --predict: several inertias from the last state, of estimators, of the truth or of TOML files "
            "(principal_moments and principal_axes_g, or inertia_g): race.json, race.csv, race.npz, race.png",
            metavar="NAME,FILE",
            cure='names of estimators, "truth" or files, such as "smoother,cad.toml"',
        ),
    ] = ()

    verdict: Annotated[
        Literal["full", "filter"] | None,
        Argument(
            "full (default): all checks; filter: only those that need no smoothed motion, which is faster, and every estimate "
            "is degraded at best",
            cure='"full" or "filter"',
        ),
    ] = None
    no_figures: Annotated[bool, Argument("write numbers only, no figures and no report")] = False
    from_truth: Annotated[
        int | None,
        NumberRange(0, 2**63 - 1, whole=True),
        Argument(
            "start from the truth with an error drawn with this seed, instead of smoothed first epochs",
            metavar="SEED",
        ),
    ] = None

    @property
    def optional_outputs(self) -> "OptionalOutputs | None":
        """Optional outputs that are asked for, or None."""
        asked = self.convergence or self.explain or bool(self.race)
        if self.predict is None and not asked and self.reference is None:
            return None
        from spinfilters.run.optional_outputs import OptionalOutputs

        race = tuple(name.strip() for text in self.race for name in text.split(",") if name.strip())
        return OptionalOutputs(self.predict, self.convergence, self.explain, self._chosen_reference, race)

    @property
    def _chosen_reference(self) -> "ReferenceMotion | None":
        """The reference, read before anything is estimated. Raises InputError."""
        if self.reference is None:
            return None
        from spinfilters.run.reference_output import chosen_reference

        return chosen_reference(self.reference, self.reference_inspector, self.reference_shares)


@dataclass(frozen=True, kw_only=True)
class CampaignArguments:
    """How a study is run; of `campaign` and of the command ``campaign run``."""

    workers: Annotated[
        int | None,
        NumberRange(1, 1024, whole=True),
        Argument("processes (default: one per processor)", metavar="N"),
    ] = None
    scheduler: Annotated[
        str | None,
        Argument(
            "a Dask scheduler, whose workers make the runs",
            metavar="tcp://HOST:PORT",
            cure="the address of a Dask scheduler",
        ),
    ] = None
    resume: Annotated[bool, Argument("continue with the rows in OUT; none is repeated")] = False
    batch: Annotated[
        bool,
        Argument(
            "make many runs at once, for filters of poses or attitudes with drawn beliefs; rows are then without verdicts"
        ),
    ] = False


@dataclass(frozen=True, kw_only=True)
class ObserveArguments:
    """Question to the analyser; of `observe` and of the command of that name."""

    sensors: Annotated[
        tuple[str, ...],
        Argument(
            "one or several sensors: stereo-tracks (or stereo), mono-tracks (or monocular), "
            "lidar-points (range, azimuth and elevation of points of the body; or lidar), lidar-poses (of registered scans), pose, "
            "attitude, gyro, magnetometer",
            flag="--sensor",
            metavar="NAME",
            cure='names of sensors such as "stereo-tracks,gyro", or a list of at least one',
        ),
    ] = ("stereo-tracks",)
    landmarks: Annotated[
        int,
        NumberRange(1, 200, whole=True),
        Argument("number of landmarks of each camera or lidar", metavar="N"),
    ] = 4
    known_map: Annotated[bool, Argument("the landmarks are known")] = False
    chart: Annotated[
        str,
        Argument(
            "coordinates of the unknowns: principal (the thesis' principal axes), tensor (inertia tensor in frame g, regular at "
            "equal moments) or filter (the filters' state)",
            cure='"principal", "tensor" or "filter"',
        ),
    ] = "principal"
    unknowns: Annotated[
        str,
        Argument(
            "inertia in the principal chart: ratios, or moments (all three, with their scale, as in chapter 3 of the thesis)",
            cure='"ratios" or "moments"',
        ),
    ] = "ratios"
    further: Annotated[
        bool,
        Argument(
            "which further sensor helps most: adds each kind to the set, one at a time, and prints what it adds, with bounds"
        ),
    ] = False
    motion: Annotated[Scenario, ArgumentGroup(only=MOTION)] = field(default_factory=Scenario)
