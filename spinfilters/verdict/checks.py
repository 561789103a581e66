"""All checks of the verdict, in the order of their sentences."""

from collections.abc import Mapping
from typing import Final

from spinfilters.models.status import ALL, BODY, MOMENTS, NOTHING, OWN_STATUS, Finding, Holds
from spinfilters.verdict import check as of_estimate
from spinfilters.verdict.check import Check, Needs, base_name

MOST_MOMENTUM: Final = 0.2
"""Relative change of the angular momentum of measured rates, from which no free body before a camera at rest is likely."""
CERTAIN: Final = "none: what it finds is a fact"
LIMIT: Final = "none by chance: a limit of usefulness"
MORE: Final = "give a longer recording, a richer motion or a larger initialisation.share"
STATE_ANOTHER: Final = "state another, or leave it out to have it identified"

CHECKS: Final[tuple[Check, ...]] = (
    # ---- what an estimator says of itself
    Check(
        "not-finite", ALL, Needs.ESTIMATE, "Are all numbers finite, and can the motion be integrated?", CERTAIN,
        "the estimate stopped being finite, or could not be computed",
        "look for wrong measurements, units and noise in the data set, or choose another estimator",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "interrupted", NOTHING, Needs.ESTIMATE, "Did the estimator take all epochs?", CERTAIN,
        "interrupted after some of the epochs", "continue with --resume",
    ),
    Check(
        "late-measurements", NOTHING, Needs.ESTIMATE, "Did all measurements come in time to be used?", CERTAIN,
        "some measurements came too late and were left out", "keep more epochs for late measurements",
    ),
    Check(
        "broken-measurements", ALL, Needs.ESTIMATE, "Did the estimate stay finite after every measurement?", CERTAIN,
        "measurements made the estimate infinite and were removed", "look for gross errors in what that sensor sends",
    ),
    Check(
        "fast-rotation", ALL, Needs.ESTIMATE, "Is each step of the embedded filter short enough for its integration?",
        CERTAIN, "the body turned too far for the substeps of a prediction", "generate the filter with more substeps",
    ),
    Check(
        "steps-left-out", ALL, Needs.ESTIMATE, "Did every step of the embedded filter stay finite?", CERTAIN,
        "steps would not have stayed finite and were left out", "look for gross errors in the measurements",
    ),
    Check(
        "smoother-unsettled", ALL, Needs.SMOOTHER, "Did the smoother's iterations converge?", CERTAIN,
        "the smoother did not converge", "raise smoother.iterations, or look for wrong measurements",
    ),
    Check(
        "filter-failed", ALL, Needs.SMOOTHER, "Did the filter finish that gives the smoother its initial guess?", CERTAIN,
        "the filter that gives the smoother its initial guess failed",
        "look for wrong measurements at the epoch where the filter fails",
    ),
    Check(
        "posterior-not-gaussian", BODY, Needs.SMOOTHER,
        "Does the Gaussian belief of the mass distribution, or do samples along its ridge represent its posterior? Pareto shape of "
        "the weights at most 0.7, of the Gaussian also mean NEES of the samples at most 2 per degree of freedom; tested where one "
        "direction has a deviation above 0.1", LIMIT,
        "the posterior of the moments is not Gaussian (Pareto shape {shape:.2g}, limit 0.7; NEES of its samples {nees:.2g}, "
        "limit 2), and samples along its ridge do not represent it (Pareto shape {samples:.2g})",
        "record a motion that wobbles",
    ),
    Check(
        "unobservable", NOTHING, Needs.SMOOTHER,
        "Is each component of the state known better than 0.7 of its prior deviation?", LIMIT,
        "the data do not determine some components of the state", "record a motion that wobbles",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "calibration-uncounted", ALL, Needs.ESTIMATE, "Could deviations include the errors of the calibration?",
        CERTAIN, "the effect of calibration errors on the estimates could not be computed",
        "state the calibration as exact, or choose the smoother",
    ),
    Check(
        "inertia-not-yet", BODY, Needs.SMOOTHER, "Does the smoother already know the mass distribution?", LIMIT,
        "the inertia is not determined yet", "wait for more epochs, or for a motion that wobbles",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "poor-fit", ALL, Needs.SMOOTHER, "Does the latest solution explain its observations within their noise?",
        "of the order of 1e-3 an epoch", "the motion found does not explain the observations within their noise",
        "wait for more epochs; if it remains, state a larger noise of the sensor",
    ),
    Check(
        "no-pose", ALL, Needs.SMOOTHER, "Do the latest epoch's observations agree on one pose?", CERTAIN,
        "the latest epoch's observations agree on no pose", "wait for the next epoch, or look for wrong associations",
    ),
    Check(
        "live", ALL, Needs.FILTER, "Running tests of a filter's latest epochs: NIS, rejected measurements, noise levels",
        "of the order of 1e-6 a window", "the filter's latest epochs contradict its model",
        "check what the sentence names: noise, clock and gross errors of the source",
    ),
    Check(
        "no-smoother", NOTHING, Needs.SMOOTHER, "Does the smoother run whose results a live filter takes over?", CERTAIN,
        "the filter continues without the smoother", "see why it ended; restart the live run to have it back",
    ),
    Check(
        "epoch-unused", ALL, Needs.FILTER, "Was any measurement of a live filter's latest epoch used?",
        "that of the gate, of every measurement of the epoch", "no measurement of this epoch was used",
        "wait for the next epoch",
    ),
    Check(
        "time-unconfirmed", ALL, Needs.RECORDING, "Does the next epoch confirm a jump of a live source's time stamps?", CERTAIN,
        "the epoch's time is far ahead of the one before", "wait for the next epoch, or check the clock of the source",
    ),
    Check(
        "prediction-range", NOTHING, Needs.ESTIMATE, "Can a live estimate be predicted as far ahead as asked?", CERTAIN,
        "it cannot be predicted so far ahead", "ask for a shorter prediction",
    ),
    Check(
        "live-disagrees", ALL, Needs.FILTER,
        "Is the last answer of a live run within 4 joint deviations of the estimate of its kept epochs?",
        "below 1e-4 a component",
        "the last answer is {deviations:.2g} joint deviations away from the estimate of the kept epochs",
        "rely on the estimate of the recording (spinfilters compare)",
    ),
    Check(
        OWN_STATUS, ALL, Needs.ESTIMATE, "Statement of an estimator or plug-in about itself", "as its author states",
        "the estimator doubts its result", "read its documentation",
    ),
    # ---- the recording and its initialisation
    Check(
        "not-initialised", ALL, Needs.INITIALISATION, "Could the first epochs be smoothed?", CERTAIN,
        "the first epochs could not be smoothed", "check the first epochs, or raise initialisation.share",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "camera-may-move", ALL, Needs.INITIALISATION,
        "Where the smoother of the first epochs did not converge: does the angular momentum change "
        f"by at most {100 * MOST_MOMENTUM:.0f} %?",
        "none unless the initialisation did not converge",
        "the initialisation did not converge, and the angular momentum seems to change by {percent:.2g} %: the camera may have "
        "moved",
        "give its known poses (inspector.tum), or fix it",
    ),
    Check(
        "initialisation-unsettled", ALL, Needs.INITIALISATION, "Did the smoother of the first epochs converge?", CERTAIN,
        "the initialisation did not converge in its iterations", "raise initialisation.iterations or initialisation.share",
    ),
    Check(
        "data-set", ALL, Needs.RECORDING, "Does the reader or the front end trust its result from raw data?", CERTAIN,
        "the measurements derived from raw data are doubtful", "check the raw data, and the remarks of their reader",
        is_cause=True,
    ),
    Check(
        "sensor-data", ALL, Needs.RECORDING, "Are the values of each sensor within its range?", CERTAIN,
        "samples of a sensor are saturated", "choose a larger range of the sensor, or cut the recording",
    ),
    Check(
        "not-a-free-flight", ALL, Needs.RECORDING,
        "Does torque-free motion explain a gyro of unknown noise to 4 % of the rate?", LIMIT,
        "not a free flight: torque-free motion leaves {percent:.2g} % of the rate unexplained, at most "
        "{limit:.2g} % can be errors of the gyro",
        "cut the recording to the flight (--segment), or check axes, range and unit of the gyro",
    ),
    Check(
        "sparse-inspector-poses", ALL, Needs.RECORDING,
        "Are the inspector's poses dense enough for its path? Errors of interpolation at most the pixel noise over "
        "the root of the number of observations in an image",
        CERTAIN,
        "the inspector's poses are too sparse for its path: {interval:.3g} s apart, their interpolation is wrong by about "
        "{millimetres:.2g} mm and {rotation:.2g} rad, which is {pixels:.2g} px",
        "give poses at the stamps of the images, or more of them (inspector.tum)",
    ),
    Check(
        "repeated-inspector-poses", ALL, Needs.RECORDING,
        "Does a moving inspector's pose repeat exactly over 3 intervals, without coming to rest before?", CERTAIN,
        "inspector.tum repeats its pose from t = {begin:.3f} s to {end:.3f} s, but the camera moves just before or after",
        "give the poses of that time, or cut the recording there (--segment)",
    ),
    Check(
        "motion-shows-no-moments", BODY, Needs.FILTER,
        "Does the estimated body predict the epochs after the initialisation better than a sphere does? "
        "Twice the log likelihood ratio is at least 30",
        "below 1e-6 of motions that wobble",
        "the motion does not determine the moments of inertia: a sphere predicts {epochs} epochs as well "
        "(evidence {evidence:.2g}, at least {limit:.2g} is needed); {why}",
        "record a motion that wobbles",
        leaves=Holds.NOT_DETERMINED,
    ),
    # ---- errors of the models
    Check(
        "front-end-slip", ALL, Needs.RECORDING,
        "Does the attitude jump by more than 60 deg, 6 times its usual departure, with the same rate before and after?",
        "below 1e-6 of white errors of attitudes", "{text}", "{cure}",
        is_cause=True,
    ),
    Check(
        "first-epochs", ALL, Needs.INITIALISATION,
        "Where the first epochs do not settle on a motion: do they settle without the first 20 % of the recording?",
        "below 3 %: none of 106 right recordings of gyros, poses and tracks with a map, of experiments.what_holds, "
        "experiments.captured_throws and python -m experiments.named_causes --causes none",
        "the first epochs are not one motion with the later ones: they leave {fit:.2g} times their noise, those from "
        "t = {time:.3f} s on {later_fit:.2g} times, as after a contact in the first epochs",
        "begin the recording there (--segment {time:.3f}:)",
        is_cause=True,
    ),
    Check(
        "correlated-errors", ALL, Needs.RESIDUALS,
        "Are measurement errors correlated in time, rather than disturbances? Probability above 0.8 and an expected NEES above 2",
        "at most 0.2 of the cases in which it fails",
        "errors of the measurements are correlated over {time:.2g} s ({sizes}; -2 ln likelihood falls by {advantage:.2g}) and "
        "resemble disturbances; deviations allow for {inflation:.2g} times the variance",
        "take measurements further apart, or a longer recording",
    ),
    Check(
        "correlated-observations", ALL, Needs.RESIDUALS,
        "Are a landmark's residuals correlated from epoch to epoch? 5 deviations of chance and an expected NEES above 2", "3e-7",
        "errors of a landmark's observations are correlated ({correlation:.2g} from epoch to epoch, {score:.2g} deviations of "
        "chance): squared errors of the estimates may be {inflation:.2g} times the stated variances",
        "use images further apart, or state the covariances of the rows with covariance_inflation",
    ),
    Check(
        "correlation-undecided", BODY, Needs.RESIDUALS,
        "Are the moments known, both with correlated measurement errors and with disturbances?", LIMIT,
        "disturbances cannot be distinguished from errors of the measurements that are correlated over {time:.2g} s ({sizes}), and "
        "deviations allow for both",
        "state process.torque_psd if it is known, or give a longer recording",
        leaves=Holds.NOT_DETERMINED,
    ),
    Check(
        "wrong-unit", ALL, Needs.RECORDING,
        "Are intervals, rates, baselines and distances plausible, and do positions agree with attitudes as they are read?",
        CERTAIN, "{text}", "{cure}",
        is_cause=True,
    ),
    Check(
        "slow-change", ALL, Needs.RESIDUALS,
        "Do the rates of a spin about one axis change slowly by more than the noise explains? Score test, Bonferroni over the list",
        "1 % of recordings, with all other model errors", "{text}", "record a motion that wobbles, or state the gyro's drift",
    ),
    Check(
        "map-error", ALL, Needs.RESIDUALS,
        "Does an error of the list explain registered poses by more than errors of their map do? Score test with shifts and "
        "rotations of second degree in the direction of view",
        "1 % of recordings, with all other model errors", "{text}", "give more scans, so that the same views come back more often",
    ),
    Check(
        "unexplained-residuals", ALL, Needs.RESIDUALS,
        "Are residuals within chance, or explained by an error of the list?",
        "1 % of recordings, with all other model errors", "{text}", "",
    ),
    Check(
        "models-not-tested", ALL, Needs.RESIDUALS, "Could errors of the models be tested?", CERTAIN,
        "errors of the models could not be tested ({text})", "check the data set and its noise",
    ),
    Check(
        "smoothed-checks-left-out", ALL, Needs.ESTIMATE, "Were the models and the noise tested about the smoothed motion?", CERTAIN,
        "models and noise were tested only in the filters' own epochs (verdict = \"filter\")",
        "use all checks (--verdict full)",
    ),
    Check(
        "model-error", ALL, Needs.RESIDUALS,
        "Score test of each error of the list about the smoothed motion; those that affect an estimate are named",
        "1 % of recordings for all errors together, 0.2 % for one that moves a state by 4 deviations "
        "and that no stated calibration excludes; measured: python -m experiments.honesty",
        "{text}", "",
    ),
    # ---- levels of noise
    Check(
        "stated-noise", ALL, Needs.RESIDUALS,
        "Score tests of all stated levels at once: beyond 4 deviations of chance and a variance 1.5 times wrong",
        "6e-5 of each level", "{name} is {stated:.3g}, the data have {seen} ({score:.2g} deviations of chance)", "{cure}",
    ),
    Check(
        "row-noise", ALL, Needs.RESIDUALS,
        "The same for deviations stated in the rows of a sensor, or by several numbers together", "6e-5 of each level",
        "{name}: the data have {times:.3g} +- {std:.1g} times the deviations that {state}{inflated} "
        "({score:.2g} deviations of chance)",
        "state other ones, or leave them out to have them identified",
    ),
    Check(
        "identified-noise", ALL, Needs.RESIDUALS,
        "The same for levels identified from the first epochs; a variance four times too small fails beyond 3 deviations of chance",
        "3e-5 of each level, 1e-3 of a variance four times too small",
        "{name} was identified as {stated:.3g} from the first epochs, all data have {seen} ({score:.2g} deviations of chance)",
        "the first epochs are too few, the noise changes, or a model is wrong: use the smoother, state the level, raise "
        "initialisation.share, or cut the recording",
    ),
    Check(
        "noise-not-tested", ALL, Needs.RESIDUALS, "Could the noise levels be tested?", CERTAIN,
        "the noise could not be tested ({text})", "check the data set and its noise",
    ),
    Check(
        "vague-initialisation", ALL, Needs.FILTER,
        "If no smoother can judge the filter: do the first epochs determine the moments to 0.12 of the largest?", LIMIT,
        "the first {epochs} epochs leave the moments uncertain by {std:.2g}: the filter becomes over-confident", MORE,
    ),
    Check(
        "over-confident", ALL, Needs.SMOOTHER,
        "Is the expected NEES of a filter or a fixed lag, with the smoother as the truth, that of a consistent filter? "
        "Whole error and mass distribution, mean over its epochs and at the last",
        "1 % of consistent filters at most",
        "over-confident: its errors{which} {where} are {times:.2g} times its stated standard deviations (root mean square), "
        "judged by the smoother",
        f"use the smoother, or {MORE}",
    ),
    Check(
        "filter-noise", ALL, Needs.FILTER,
        "Chi-square of the part of a filter's innovations that no state explains: 5 deviations of chance and a variance "
        "1.5 times wrong",
        "6e-7", "the errors of the {name} have {times:.2g} times the {level} ({score:.2g} deviations of chance)", "{cure}",
    ),
    Check(
        "filter-disturbance", ALL, Needs.FILTER,
        "Chi-square of a filter's corrections along the disturbances: 5 deviations of chance and a density 1.5 times wrong",
        "6e-7",
        "disturbances have {times:.2g} times the {level} ({score:.2g} deviations of chance): process.{name} is {ratio:.2g} times "
        "{before}, or the model is wrong",
        "state process.{name}, or leave it out to have it identified",
    ),
    Check(
        "correlated-corrections", ALL, Needs.FILTER,
        "Are a filter's corrections of neighbouring epochs correlated? 5 deviations of chance and 0.15", "3e-7",
        "corrections of neighbouring epochs are correlated ({correlation:.2g}, {score:.2g} deviations of chance): an error of "
        "model, clock or calibration, or disturbances that are stated too small",
        "compare with --explain, or raise process.force_psd and process.torque_psd",
    ),
    # ---- the estimate itself
    Check(
        "moments-undetermined", frozenset({MOMENTS}), Needs.ESTIMATE,
        f"Is each moment's deviation at most {of_estimate.LARGEST_MOMENT_STD} of the largest moment?", LIMIT,
        "the moments of inertia are not determined: their standard deviation is {std:.2g} of the largest moment (limit "
        "{limit:.2g})",
        "record a motion that wobbles, or a longer one", of_estimate.moments_undetermined, Holds.NOT_DETERMINED,
    ),
    Check(
        "moment-may-be-zero", frozenset({MOMENTS}), Needs.ESTIMATE,
        f"Is the smallest moment {of_estimate.CLEAR_OF_ZERO:g} deviations above zero?", LIMIT,
        "the smallest moment of inertia, {moment:.2g} ± {std:.2g} of the largest, may be zero: the body is a needle, and its "
        "ratio k2 has no upper bound",
        "record a motion with more rotation about the long axis, or a longer one", of_estimate.moment_may_be_zero,
    ),
    Check(
        "innovations-too-large", ALL, Needs.FILTER, f"Is the NIS per degree of freedom at most {of_estimate.LARGEST_NIS}?",
        "below 1e-6 from 20 degrees of freedom on",
        "innovations are {times:.2g} times as large as the noise explains (NIS {ratio:.2g} per degree of freedom)",
        "raise process.force_psd, process.torque_psd or the sensor's standard deviation in a config file",
        of_estimate.innovations_too_large,
    ),
    Check(
        "innovations-too-small", NOTHING, Needs.FILTER,
        f"Is the NIS per degree of freedom at least {of_estimate.SMALLEST_NIS:g}, or that share of what correlated or inflated "
        "noise leaves of it?",
        f"{of_estimate.FALSE_ALARM:.0e}, below {of_estimate.SMALLEST_NIS:g} by chance",
        "the assumed noise is far larger than the measurements show: innovations are {times:.2g} times smaller than it explains "
        "(NIS {ratio:.2g} per degree of freedom), so deviations are too wide",
        "state a smaller noise of the sensor or of the disturbances in a config file, or leave it out to have it identified",
        of_estimate.innovations_too_small,
    ),
    Check(
        "measurements-left-out", ALL, Needs.ESTIMATE,
        f"Are at most {of_estimate.LARGEST_REJECTED:.0%} of the measurements rejected?", "below 1e-6",
        "{rejected} of {total} measurements ({percent:.2g} %) could not be used or were rejected",
        "look for gross errors, wrong associations or too small a stated noise", of_estimate.measurements_left_out,
    ),
    Check(
        "epochs-refused", ALL, Needs.ESTIMATE,
        "Are no more whole epochs rejected, in all or in a row, than false alarms of the gate explain?",
        f"{of_estimate.FALSE_ALARM:.0e} of recordings of any length",
        "{count} of {epochs} epochs gave no information, {longest} in a row ({expected:.2g} by chance): all their measurements "
        "were rejected, or only repeated the previous epoch",
        "cut the recording there, or look for gross errors and repeated images", of_estimate.epochs_refused,
    ),
    Check(
        "gap", NOTHING, Needs.RECORDING,
        f"Is no interval longer than {of_estimate.LARGEST_GAP:g} median intervals?", CERTAIN,
        "nothing was measured for {seconds:.3g} s after t = {begin:.3f} s: estimates in between are predictions",
        "cut the recording there if the body may have been touched", of_estimate.gap,
    ),
    Check(
        "estimators-disagree", BODY, Needs.PEERS,
        f"Do the moments of any two estimators agree within {of_estimate.DISAGREEMENT_STD:g} of both deviations, or "
        f"{of_estimate.DISAGREEMENT}?",
        "6e-5 of independent estimators, less of those of the same measurements",
        "its moments differ from those of {other} by up to {difference:.2g} of the largest",
        "use the one that is ok, the smoother rather than a filter", of_estimate.estimators_disagree,
    ),
)  # fmt: skip
"""Every check, by the order of its sentences in a verdict."""

BY_NAME: Final[Mapping[str, Check]] = {check.name: check for check in CHECKS}


def finding(
    check: str,
    numbers: Mapping[str, float | str],
    about: frozenset[str] | None = None,
    which: str = "",
) -> Finding:
    """Finding of a check of the list, by its name; see `Check.finding`.

    Raises
    ------
    KeyError
        No such check, or a number that its sentence needs is missing.
    """
    return BY_NAME[check].finding(numbers, about, which)


def check_of(found: Finding) -> Check:
    """The check that a finding failed; that of an estimator's own words for a name that is not in the list."""
    return BY_NAME.get(base_name(found.check), BY_NAME[OWN_STATUS])
