"""What GTSAM cannot solve costs a hypothesis; a mistake in a user's model is not hidden by that."""

import pytest

from semantic_slam.inference.smoothing.errors import LostComponentError, lost_where_indeterminate


def test_an_indeterminate_system_is_a_lost_component() -> None:
    what = r"an update failed \(Indeterminant linear system\)"
    with pytest.raises(LostComponentError, match=what), lost_where_indeterminate("an update"):
        raise RuntimeError("\nIndeterminant linear system\nmore about it")


@pytest.mark.parametrize("mistake", [NotImplementedError, RecursionError, TypeError])
def test_a_mistake_in_a_model_is_let_through(mistake: type[Exception]) -> None:
    with pytest.raises(mistake), lost_where_indeterminate("an update"):
        raise mistake("model")
