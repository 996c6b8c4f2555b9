"""Words of sentences: ranges, lists."""

from mppi_belief.report.wording import count_range, listed


def test_a_range_of_one_value_is_the_value():
    assert count_range([200, 200]) == "200"
    assert count_range([200, 170, 198]) == "170 to 200"
    assert count_range([]) == "0"


def test_lists_end_in_and():
    assert [listed(["a", "b", "c"][:k]) for k in range(4)] == ["", "a", "a and b", "a, b and c"]
