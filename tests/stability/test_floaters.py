"""Floaters hang about the person: a search that sees them stands close behind one, where the scene has nothing."""

from cltransfer.bench.stress.trial import StressTrial, run_stress


def ended(options: tuple[str, ...]) -> float:
    """Total of what ``fast`` finds for a dolly zoom among 50 floaters, judged in the scene without them."""
    trial = StressTrial("fast", "floaters", 2, "dolly_zoom", "stage-4004", "path-4005", 2002, 3, options)
    return float(run_stress(trial)["total"])


def test_a_search_is_not_lured_by_floaters() -> None:
    assert ended(()) < 5 < 10 < ended(("floaters=keep",))  # measured 3.2 and 14.4
