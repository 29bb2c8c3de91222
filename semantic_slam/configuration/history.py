"""How many poses stay variables in drives of hours."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class HistoryConfiguration:
    horizon_keyframes: int = parameter(
        0,
        "newest keyframes whose poses stay variables, for drives of hours: more than the longest loop has; older ones"
        " are summarised in one Gaussian of what they saw, and the path keeps them as they were then; 0: all stay",
        minimum=0,
    )

    @property
    def is_on(self) -> bool:
        """Whether poses of long ago are summarised."""
        return self.horizon_keyframes > 0
