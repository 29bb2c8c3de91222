"""Claims and tables of the study of faulty rooms."""

from typing import Any

from semantic_slam_lab.studies.result import REQUIREMENT, Claim, Table

LEAST_NAMED, MOST_ECE, MOST_WITH_GHOST = 0.9, 0.02, 0.05
OURS = "known_map"
COLUMNS = (
    "fault",
    "configuration",
    "rooms",
    "lost",
    "named",
    "could be",
    "sure and wrong",
    "told by `unexplained`",
    "of these lost",
    "first keyframe told",
    "position error",
    "CPU",
)


def claims_of(result: dict[str, Any]) -> list[Claim]:
    """No room lost, faults named, existence right."""
    closed, opened = result["closed"], result["open"]

    def lost(fault: str, most: int) -> Claim:
        found = closed[fault][OURS]
        text = f"{fault}: at most {most} rooms lost"
        return Claim(text, REQUIREMENT, "", f"{found['lost']} of {found['rooms']}", found["lost"] <= most)

    def named(fault: str) -> list[Claim]:
        found = closed[fault][OURS]
        count, sure = found["rooms"], found["sure_and_wrong"]
        enough = found["named"] >= LEAST_NAMED * count
        bound = "" if found["nameable"] is None else f"; with associations known {found['nameable']}"
        return [
            Claim(f"{fault}: named in 18 of 20 rooms", REQUIREMENT, "", f"{found['named']} of {count}{bound}", enough),
            Claim(f"{fault}: nothing sure and wrong", REQUIREMENT, "", f"{sure} of {count} rooms", sure == 0),
        ]

    judged = [own["credible"] for own in opened["bins"] if own["credible"] is not None]
    false_alarms = closed["nothing wrong"][OURS]
    return [
        lost("first view wrong", 0),
        lost("10 % of views wrong", 1),
        lost("1 % of places anywhere", 0),
        *named("an object not on the map"),
        *named("two objects displaced by 1 m"),
        *named("two objects displaced by 1 m, map to 0.1 m"),
        Claim(
            "Under a right model nothing is unexplained",
            REQUIREMENT,
            "",
            f"{false_alarms['unexplained']} of {false_alarms['rooms']} rooms",
            false_alarms["unexplained"] == 0,
        ),
        Claim(
            "Existence at first and last keyframe: ECE at most 0.02",
            REQUIREMENT,
            "",
            f"{opened['ece']:.3f}",
            opened["ece"] <= MOST_ECE,
        ),
        Claim(
            "Existence: every bin of 20 entries inside its 99 % interval",
            REQUIREMENT,
            "",
            f"{sum(not own for own in judged)} of {len(judged)} bins off",
            all(judged),
        ),
        Claim(
            "A ghost in at most 5 % of the open rooms",
            REQUIREMENT,
            "",
            f"{opened['rooms_with_ghost']:.1%}",
            opened["rooms_with_ghost"] <= MOST_WITH_GHOST,
        ),
    ]


def tables_of(result: dict[str, Any]) -> list[Table]:
    """Closed rooms, and existence."""
    rows = [row_of(fault, name, own) for fault, rows in result["closed"].items() for name, own in rows.items()]
    bins = [
        (f"{own['mean']:.2f}", f"{own['share']:.2f}", str(own["count"]), _credible(own["credible"]))
        for own in result["open"]["bins"]
    ]
    return [
        Table("Rooms with a known map", COLUMNS, tuple(rows)),
        Table("Existence, stated and observed", ("stated", "exists", "entries", "credible"), tuple(bins)),
    ]


def row_of(fault: str, name: str, own: dict[str, Any]) -> tuple[str, ...]:
    """One fault under one configuration, as :data:`COLUMNS` has it."""
    return (
        fault,
        f"`{name}`",
        *(
            str(own[key]) if own[key] is not None else "–"
            for key in ("rooms", "lost", "named", "nameable", "sure_and_wrong")
        ),
        str(own["unexplained"]),
        f"{own['lost_and_unexplained']} of {own['lost']}",
        f"{own['first_unexplained']:.0f}" if own["first_unexplained"] is not None else "–",
        f"{own['position_error_m']:.2f} m",
        f"{own['cpu_s']:.1f} s",
    )


def _credible(value: bool | None) -> str:
    return "–" if value is None else ("yes" if value else "no")
