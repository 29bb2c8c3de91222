"""A hypothesis that takes an object's first view for an outlier knows no more of its class than before."""

import numpy as np
from worlds.scenes.planar_world import beliefs, make_world


def test_a_first_view_that_is_an_outlier_tells_no_class():
    kept = {"pruning": {"ratio": 1e6, "max_hypotheses": 200}}
    belief = beliefs(make_world(1, sigma_start_m=0.05, semantic_model={"kind": "parametric"}, **kept), 1)[0]
    probabilities = belief.hypothesis_class_probabilities
    seen = np.unique(belief.associations[belief.associations >= 0])
    is_open = probabilities[:, seen].max(axis=2) < 1.0
    assert is_open.any() and not is_open.all()
    np.testing.assert_array_equal(probabilities[:, seen][is_open], 0.5)
