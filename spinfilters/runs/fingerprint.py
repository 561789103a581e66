"""Fingerprint of a run, which ties a checkpoint to its data, settings and versions."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from spinfilters.data.input_file import value_text
from spinfilters.estimators.landmarks.belief import LandmarkBelief
from spinfilters.estimators.timeline import Timeline
from spinfilters.runs.provenance import provenance
from spinfilters.state.gaussian import Gaussian

ANEW = "or run without --resume to begin anew"


@dataclass(frozen=True)
class RunFingerprint:
    """Everything that decides the numbers of a run.

    Attributes
    ----------
    estimator: its name.
    versions: of this package, its commit, and the libraries.   settings: of the run, tables of plain values.
    measurements: digest of all epochs, values and parameters.   start: digest of the belief that the estimator starts from.
    """

    estimator: str
    versions: Mapping[str, Any]
    settings: Mapping[str, Any]
    measurements: str
    start: str

    @property
    def document(self) -> dict[str, Any]:
        """The fingerprint for JSON."""
        return json.loads(json.dumps(asdict(self)))

    def difference(self, document: Mapping[str, Any]) -> str | None:
        """First difference from another run's `document`, with the cure.

        None where it does not differ.

        Raises
        ------
        KeyError, TypeError, AttributeError: it is no such document.
        """
        return next(_differences(document, self.document), None)


def fingerprint_of(
    estimator: str, timeline: Timeline, start: Gaussian | LandmarkBelief, settings: Mapping[str, Any]
) -> RunFingerprint:
    """The fingerprint of a run.

    Over all epochs of a timeline, from a start, with settings (tables of plain values).
    The choice of estimators is left out: each runs by itself.
    """
    document = {name: value for name, value in settings.items() if name != "estimators"}
    return RunFingerprint(estimator, provenance(), document, _digest_of_timeline(timeline), _digest_of(start))


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> Iterator[str]:
    if there["estimator"] != here["estimator"]:
        yield f"is of the estimator {value_text(there['estimator'])}, not of {here['estimator']}; put it back, {ANEW}"
    for name, was, is_now in _changed(there["versions"], here["versions"]):
        yield f"was made with {name} {was}, this is {is_now}; resume with the former, {ANEW}"
    for name, was, is_now in _changed(there["settings"], here["settings"]):
        yield f"was made with {name} = {was}, now it is {is_now}; set it back, {ANEW}"
    if there["measurements"] != here["measurements"]:
        yield (
            f"was made from other measurements (digest {_short(there['measurements'])}, now "
            f"{_short(here['measurements'])}); give the same data set, {ANEW}"
        )
    if there["start"] != here["start"]:
        yield (
            "goes on from a start that comes out differently here (another machine or number of threads); resume where it was "
            f"made, {ANEW}"
        )


def _changed(there: Any, here: Any, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Name, former and present value of everything that differs in two documents of nested tables."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in sorted({*there, *here}):
            yield from _changed(there.get(key), here.get(key), f"{path}.{key}" if path else str(key))
    elif there != here:
        yield path, value_text(there), value_text(here)


def _short(digest: object) -> str:
    return value_text(str(digest)[:12])


def _digest_of_timeline(timeline: Timeline) -> str:
    digest = hashlib.sha256()
    for epoch in timeline:
        digest.update(f"{epoch.time.hex()} {len(epoch.measurements)}\n".encode())
        for measurement in epoch.measurements:
            arrays = (measurement.values, measurement.parameters, measurement.ids)
            digest.update(
                f"{measurement.model.name} {[None if a is None else a.shape for a in arrays]}".encode()
            )
            for array in arrays:
                digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()


def _digest_of(belief: Gaussian | LandmarkBelief) -> str:
    digest = hashlib.sha256(" ".join(belief.layout.blocks).encode())
    joint = belief.joint
    landmarks = () if joint is None else (joint.ids, joint.points, joint.modes, joint.roots)
    for array in (belief.mean, belief.factor, *landmarks):
        digest.update(f"{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()
