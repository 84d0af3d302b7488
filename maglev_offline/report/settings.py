"""The `[report]` table of a recipe."""

from pydantic import Field

from maglev_offline.settings import Settings


class ReportSettings(Settings):
    """What the report shows.

    `example_log`: name of the log whose trajectories are drawn (not given: the first `example_logs` of them);
    `example_duration_s`: how much of each.
    """

    title: str = "Does logged PID data help a learning suspension controller?"
    example_log: str | None = None
    example_logs: int = Field(default=4, ge=1)
    example_duration_s: float = Field(default=20.0, gt=0)
