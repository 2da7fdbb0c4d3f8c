"""Nothing that a page shows tells one method from another."""

import itertools

from cltransfer.study.design import design


def test_the_order_of_the_comparisons_says_nothing_about_methods() -> None:
    """Whoever takes what three comparisons share for the first, second and third method is not right throughout."""
    methods = ("a", "b", "c")
    study = design([f"s{i}" for i in range(30)], methods, [], 0)
    right = []
    for _, group in itertools.groupby(study.items, key=lambda item: item.sample):
        first, second, third = ({item.first, item.second} for item in group)
        shared = (first & second, first & third, second & third)
        right.append(all(study.clips[next(iter(token))].method == m for token, m in zip(shared, methods)))
    assert len(right) == 30
    assert 1 <= sum(right) <= 15


def test_a_comparison_holds_its_clips_in_the_order_of_the_methods() -> None:
    methods = ["z", "a", "m"]
    study = design(["s", "t"], methods, [], 3)
    pairs = [(study.clips[item.first].method, study.clips[item.second].method) for item in study.items]
    assert all(methods.index(first) < methods.index(second) for first, second in pairs)
    assert sorted(pairs) == sorted(2 * list(itertools.combinations(methods, 2)))
