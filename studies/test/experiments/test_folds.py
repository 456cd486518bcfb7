import pytest

from geodesic_motion_ros.utils.errors import DemonstrationError, ParameterError
from geodesic_motion_studies.experiments.folds import all_folds, default_folds, parse_folds


def test_every_split_is_there_once():
    splits = all_folds(5)
    assert len(splits) == len(set(splits)) == 10
    assert all(len(set(split)) == 3 and set(split) <= set(range(5)) for split in splits)
    with pytest.raises(DemonstrationError, match="leaves none to train on"):
        all_folds(3)


def test_folds_are_parsed():
    assert parse_folds("0,3,6/1,4,7/2,5,8", 9) == ((0, 3, 6), (1, 4, 7), (2, 5, 8))
    assert parse_folds(" 1 , 2 ", 3) == ((1, 2),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,3,9", "there is no demonstration 9; the 9 are numbered 0 to 8"),
        ("-1", "there is no demonstration -1"),
        ("0,3/", "'' is not a list of indices; write them like 0,3,6/1,4,7/2,5,8"),
        ("0;3", "'0;3' is not a list of indices"),
        ("1,1", "'1,1' holds out a demonstration twice"),
        ("0,1,2,3,4,5,6,7,8", "leaves no demonstration to train on"),
    ],
)
def test_bad_folds_are_refused(text, message):
    with pytest.raises(ParameterError, match=message):
        parse_folds(text, 9)


def test_default_folds_hold_every_demonstration_out_once():
    assert default_folds(9) == ((0, 3, 6), (1, 4, 7), (2, 5, 8))
    assert default_folds(2) == ((0,), (1,))
    assert sorted(sum(default_folds(8), ())) == list(range(8))
    with pytest.raises(DemonstrationError, match="at least 2"):
        default_folds(1)
