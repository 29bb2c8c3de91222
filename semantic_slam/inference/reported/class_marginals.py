"""Class marginals of objects in each hypothesis, for a backend's report."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.object_views import class_posterior
from semantic_slam.inference.world.objects import ReportedObjects


def add_class_marginals(
    table: ObjectTable, components: Sequence[Component], reported: ReportedObjects, false_alarms: float
) -> None:
    """Write class probabilities and view statistics into ``table``, from enumerated classes or else from view records.

    The table's rows are the components, over the reported objects, and hold the values of unseen objects before.
    ``false_alarms``: share of the views of known objects that are not recognised.
    """
    row_of, probabilities = reported.row_of, table.class_probabilities
    viewed = [
        (h, row_of[n], views)
        for h, component in enumerate(components)
        for n, views in component.views.items()
        if n in row_of
    ]
    if viewed:
        h, rows, records = zip(*viewed, strict=True)
        table.mutual_information[h, rows] = [views.mutual_information for views in records]
        judged = [len(components[number].views) for number in h]
        table.in_coverage[h, rows] = [
            views.coverage.holds(false_alarms, count) for views, count in zip(records, judged, strict=True)
        ]
        table.forgotten_views[h, rows] = [views.dropped for views in records]
        if probabilities.shape[2]:
            likelihood = np.array([views.log_likelihood for views in records])
            probabilities[h, rows] = class_posterior(reported.log_class_prior[list(rows)], likelihood)
    named = [
        (h, row_of[n], cls)
        for h, component in enumerate(components)
        for n, cls in component.classes.items()
        if n in row_of
    ]
    if named:
        h, rows, classes = zip(*named, strict=True)
        probabilities[h, rows], probabilities[h, rows, classes] = 0.0, 1.0
