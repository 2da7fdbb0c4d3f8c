"""Which term a stress made worse."""

from cltransfer.bench.stress.verdicts import _grown_most


def test_a_term_that_had_no_value_before_has_not_grown() -> None:
    before = [{"terms": {"framing": 1.0, "filmic_space": None}}]
    assert _grown_most(before, [{"terms": {"framing": 1.0, "filmic_space": 0.9}}]) == ""
    assert _grown_most(before, [{"terms": {"framing": 1.5, "filmic_space": 0.9}}]) == "framing"
    assert _grown_most(before, [{"terms": {"framing": None, "filmic_space": 0.9}}]) == ""
