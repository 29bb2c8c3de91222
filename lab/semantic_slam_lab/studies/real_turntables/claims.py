"""The thesis's statements and the project's requirements beside what photographs show."""

from collections.abc import Mapping, Sequence
from typing import Any

from semantic_slam_lab.studies.ch3.pages import number
from semantic_slam_lab.studies.real_turntables.latent_models import FORMULATIONS
from semantic_slam_lab.studies.result import REQUIREMENT, Claim

LEAST_CORRECT = 0.95
SHARE_OF_MGR, LEAST_MGR = 0.1, 0.5
LEAST_PEAK = 0.95
LEAST_INSIDE = 0.9
"""Share of lots of one view per object whose NEES is in its 95 % band; below 95 %, for all draw on the same views."""
NEW_NEES = (0.5, 2.0)
WORDS = {
    "model": "places exact, half of the views in rooms",
    "localisation_10cm": "the same, places off by 10 cm",
    "localisation_20cm": "the same, places off by 20 cm",
    "map": "MAP",
    "energy": "energy",
}
SOURCES = {"model": "Table 3.1", "localisation_10cm": "Table 3.2", "localisation_20cm": "Table 3.2"}
THESIS = {
    "model": "Model Based 0.74, theirs 0.76; log MGR 95 % 629.2 against 2.46",
    "localisation_10cm": "hard track: Model Based 0.66, theirs 0.72; log MGR 95 % 48.6 against 1.1",
    "localisation_20cm": "",
}

Result = Mapping[str, Any]


def claims_of(result: Result) -> list[Claim]:
    """All of them, chapter by chapter."""
    found = [claim for name, methods in result["classification"].items() for claim in _classification(name, methods)]
    found.append(_ambiguity(result["ambiguity"]))
    for name in FORMULATIONS:
        found += _latent(name, result["latent"][name])
    return found


def _classification(name: str, methods: Result) -> list[Claim]:
    ours, theirs, simple = (methods[method] for method in ("ours", "model_based", "simple_bayes"))
    final = ours["correct_rate_final"]
    told = f"{final:.3f}; Model Based {theirs['correct_rate_final']:.3f}, "
    told += f"Simple Bayes {simple['correct_rate_final']:.3f}"
    text = f"At the end of a track right in {LEAST_CORRECT:.0%} ({WORDS[name]})"
    found = [Claim(text, REQUIREMENT, "", told, final >= LEAST_CORRECT)]
    for when in ("final", "overall"):
        column = f"log_mgr_{when}_p95"
        limit = max(SHARE_OF_MGR * theirs[column], LEAST_MGR)
        text = f"95th percentile of the {when} log MGR at most {SHARE_OF_MGR:g} of Model Based's, or {LEAST_MGR} nats"
        told = f"{number(ours[column])} against {number(theirs[column])}, Simple Bayes {number(simple[column])}"
        found.append(Claim(f"{text} ({WORDS[name]})", REQUIREMENT, "", told, ours[column] <= limit))
    columns = ("log_mgr_final_p75", "log_mgr_final_p95", "log_mgr_overall_p75", "log_mgr_overall_p95")
    told = "; ".join(
        f"{column.replace('_', ' ')} {number(ours[column])}, {number(theirs[column])}" for column in columns
    )
    holds = all(ours[column] <= theirs[column] + 1e-6 for column in columns)
    text = f"No column of the log MGR is greater than Model Based's ({WORDS[name]})"
    return [*found, Claim(text, SOURCES[name], THESIS[name], told, holds)]


def _ambiguity(pairs: Sequence[Result]) -> Claim:
    told = "; ".join(f"{own['pair']}: {own['behind']:.2f} behind, {own['front']:.2f} in front" for own in pairs)
    front, behind = (sum(own[key] for own in pairs) / len(pairs) for key in ("front", "behind"))
    text = "Which of two look-alikes it is stays open from behind and not in front (entropy of one view, nats; mean"
    text += f" {behind:.2f} against {front:.2f})"
    return Claim(text, "Sec. 3.4.4", "", told, behind > front)


def _latent(name: str, own: Result) -> list[Claim]:
    words, peak, (low, high) = WORDS[name], own["peak_within_10deg"], own["nees_band"]
    flat = [number for number in own["objects"].values() if not number["can_be_told"]]
    told = f"{peak:.3f} over {own['objects_told']} objects; {len(flat)} whose azimuth nothing tells"
    text = f"{words}: peak over azimuth within 10° in {LEAST_PEAK:.0%} of held-out views of objects that can be told"
    inside = own["nees_one_view_in_band"]
    nees = f"{inside:.0%} of lots in [{low:.2f}, {high:.2f}]; over all views {own['nees']:.2f}"
    widened, plain = own["new_nees_widened"], own["new_nees"]
    return [
        Claim(text, REQUIREMENT, "", told, peak >= LEAST_PEAK),
        Claim(
            f"{words}: azimuth NEES, one view per object by lot, in its 95 % band in {LEAST_INSIDE:.0%} of the lots",
            REQUIREMENT,
            "",
            nees,
            inside >= LEAST_INSIDE,
        ),
        Claim(
            f"{words}: new objects' NEES from {NEW_NEES[0]} to {NEW_NEES[1]:.0f}, widened by what the decoder lacks",
            REQUIREMENT,
            "",
            f"{widened:.2f} over {own['new_objects']:.0f} objects; not widened {plain:.2f}",
            NEW_NEES[0] <= widened <= NEW_NEES[1],
        ),
    ]
