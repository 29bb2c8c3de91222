"""Report page ``calibration.html``: candidates tried, their outcomes, and inferred values."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.calibration.calibrate import Calibration
from semantic_slam.calibration.configuration_file import text_of
from semantic_slam.calibration.search import LEAST_GAIN, Trial
from semantic_slam.calibration.truth import truth_beside
from semantic_slam.report.drawing.charts import Chart, Key, keyframes, time_plot
from semantic_slam.report.drawing.noise_charts import noise_charts
from semantic_slam.report.rendering import environment


@dataclass(frozen=True)
class TrialRow:
    """One line of the table of candidates."""

    quantity: str
    values: str
    log_evidence: float
    gain: float
    verdict: str


@dataclass(frozen=True)
class ChangeRow:
    """One line of the table of changes."""

    name: str
    before: str
    after: str
    quantity: str
    gain: float


def render_page(found: Calibration, base: str) -> str:
    """Text of the page; ``base`` is the name of the initial configuration."""
    return (
        environment()
        .get_template("calibration.html")
        .render(
            title=found.drive.bag.name,
            base=base,
            bag=str(found.drive.bag),
            num_keyframes=found.first.num_keyframes,
            num_detections=found.first.num_detections,
            damage=found.first.damage,
            first=found.first.log_evidence,
            gain=found.gain,
            least_gain=LEAST_GAIN,
            changes=[
                ChangeRow(name, text_of(own.before), text_of(own.after), own.quantity, own.gain)
                for name, own in found.changes.items()
            ],
            trials=[_row(own) for own in found.trials],
            charts=[*_gained(found), *noise_charts(found.record_after.beliefs)],
            truth=truth_beside(found),
        )
    )


def _row(trial: Trial) -> TrialRow:
    values = ", ".join(f"{name} {text_of(value)}" for name, value in trial.values.items())
    verdict = f"cannot be compared: {trial.fault}" if trial.fault else "kept" if trial.is_kept else ""
    return TrialRow(trial.quantity, values, trial.log_evidence, trial.gain, verdict)


def _gained(found: Calibration) -> list[Chart]:
    """The chart of what changes have gained; none where nothing was changed."""
    return [gain_chart(found)] if found.changes else []


def gain_chart(found: Calibration) -> Chart:
    """Chart of the evidence gained over the drive."""
    before, after = (
        np.array([belief.log_evidence for belief in record.beliefs])
        for record in (found.record_before, found.record_after)
    )
    gains = np.cumsum(after - before)
    low, high = min(0.0, float(gains.min())), max(1.0, float(gains.max()))
    room = 0.05 * (high - low)
    beliefs = found.record_after.beliefs
    plot = time_plot(beliefs, low - room, high + room, "nats gained so far")
    plot.axes()
    plot.line(keyframes(beliefs), gains, "line first")
    text = "Nats by which all detections so far are likelier under the calibrated configuration."
    return Chart("Evidence gained", text, [Key("first", "gained", gains.tolist())], plot.svg())
