"""What the thesis says of Figs. 3.14 to 3.18, beside what was measured."""

from collections.abc import Mapping
from typing import Any

from semantic_slam_lab.studies.ch3.pages import COLUMNS, number
from semantic_slam_lab.studies.rendered.pages import ROUNDING
from semantic_slam_lab.studies.rendered.realisations import WORDS
from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Table

SOURCE = "Sec. 3.4.5.2, Fig. 3.17"
TENFOLD = 2.302585
"""Nats: a wrong class ten times as probable as the true one."""


def claims(result: Mapping[str, Any]) -> list[Claim]:
    """For every set of features that differs from those before: the same four twice would be no second witness."""
    found: list[Claim] = []
    seen: list[Any] = []
    for name, part in result["feature_sets"].items():
        if part["components"] in seen:
            continue
        seen.append(part["components"])
        found += _of_set(part, f"features by {name.replace('_', ' ')}")
    shares, known = result["wrong_share_of_bias_map"], result["right_without_bias"]
    misled = [share for share, right in zip(shares, known, strict=True) if right and share > 0.0]
    text = "Some views are right without a bias of the location and wrong with another one (Model Based, single views)"
    told = (
        f"{len(misled)} of {len(shares)} views, where up to {max(misled, default=0.0):.0%} of the biases within 60 cm"
        f" are wrong; {len(known) - sum(known)} more are wrong without any"
    )
    sets = [part["components"] for part in result["feature_sets"].values()]
    different = "another set" if sets[0] != sets[1] else "the same four"
    found.append(Claim(text, "Fig. 3.18", "views 3 and possibly 6 of those shown", told, bool(misled)))
    told = "; ".join(", ".join(result["settings"]["scores"][index] for index in chosen) for chosen in sets)
    text = "An importance ranking chooses other features than the greatest scores"
    return [*found, Claim(text, "Fig. 3.16", "other components", f"{different}: {told}", sets[0] != sets[1])]


def tables(result: Mapping[str, Any]) -> list[Table]:
    """A table per set of features."""
    return [
        Table(
            f"Features by {name.replace('_', ' ')}, {result['settings']['realisations']} realisations, sigma 30 cm",
            ("method", *COLUMNS.values()),
            tuple(
                (WORDS[method], *(number(row[column]) for column in COLUMNS)) for method, row in part["methods"].items()
            ),
        )
        for name, part in result["feature_sets"].items()
    ]


def _of_set(part: Mapping[str, Any], where: str) -> list[Claim]:
    methods, alone = part["methods"], part["p_true_with_bias_alone"]
    ours, theirs = methods["ours"], methods["model_based"]
    without = part["p_true_without_bias"]
    least = {name: min(alone[name]) for name in ("ours", "model_based")}
    last = {name: alone[name][-1] for name in ("ours", "model_based")}
    tail = tuple(row["log_mgr_final_p95"] for row in (ours, theirs))
    rates = tuple(row["correct_rate_final"] for row in (ours, theirs))
    nll = {name: row["nll"] for name, row in methods.items()}
    return [
        Claim(
            f"With the bias alone Model Based is misled on the way and recovers, ours is not ({where})",
            SOURCE,
            "no number",
            f"least P(true class) on the way: ours {least['ours']:.3f}, Model Based {least['model_based']:.3g}; at the"
            f" end {last['ours']:.3f}, {last['model_based']:.3f}. Without the bias the least is"
            f" {min(without['ours']):.3f}, {min(without['model_based']):.3g}",
            least["model_based"] < 0.5 * min(without["model_based"])
            and least["ours"] > least["model_based"]
            and last["ours"] > 0.5
            and last["model_based"] > 0.5,
        ),
        Claim(
            f"At the end most runs are right with either method ({where})",
            SOURCE,
            "most",
            f"ours {rates[0]:.2f}, Model Based {rates[1]:.2f}",
            min(rates) > 0.5,
        ),
        Claim(
            f"Model Based's worst runs end with a wrong class ten times as probable as the true one, ours do not"
            f" ({where}; 95 % of the final log MGR)",
            SOURCE,
            "about 10 % of Model Based's runs, none of theirs",
            f"ours {number(tail[0])}, Model Based {number(tail[1])}",
            tail[1] >= TENFOLD > tail[0],
        ),
        Claim(
            f"Ours has the lowest NLL ({where})",
            REQUIREMENT,
            "",
            ", ".join(f"{name.replace('_', ' ')} {number(value)}" for name, value in nll.items()),
            all(nll["ours"] <= value + ROUNDING for name, value in nll.items() if name != "joint"),
        ),
    ]
