"""Classes from two tagged instances each (Sec. 5.6.A): Gaussians, nearest neighbours, and supervised classifiers."""

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.rows import take
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.latent.model import DescriptorBelief
from semantic_slam.training.latent.fitting.class_grounding import ground, nearest_class
from semantic_slam.training.latent.judging.estimation import infer_descriptors
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.simulation.goods import goods_class
from semantic_slam_lab.studies.ch5.models import DEFAULT, FORMULATIONS, WORDS, chosen_goods, trained
from semantic_slam_lab.studies.ch5.pages import framed
from semantic_slam_lab.studies.ch5.views import measured, validation_views
from semantic_slam_lab.studies.result import Claim, Table, write_result

NAME = "ch5_grounding"
TAGGED = 2
DRAWS, QUICK_DRAWS = 20, 2
QUICK_INSTANCES = 24
VIEWS = 3
"""Views of known direction that a descriptor is inferred from where several are used."""
METHODS = {
    "gaussian_3_views": "Gaussians P(e | c), e from 3 views of known direction",
    "nearest_3_views": "nearest tagged descriptor, e from 3 views of known direction",
    "gaussian_1_view": "Gaussians, e from the encoder, one view",
    "nearest_1_view": "nearest tagged descriptor, encoder, one view",
    "supervised_1_view": "supervised on the views of the same tagged instances, one view",
    "supervised_3_views": "the same, three views",
    "supervised_all_1_view": "supervised on all known instances but those judged, one view",
    "supervised_all_3_views": "the same, three views",
}


def run(out: Path, *, quick: bool, jobs: int, seed: int) -> list[Path]:
    """Render, tag by lot, classify what is not tagged; returns the files written."""
    names = chosen_goods(QUICK_INSTANCES if quick else None)
    views = validation_views(names, jobs)
    draws = QUICK_DRAWS if quick else DRAWS
    numbers = {}
    for name in (*FORMULATIONS, DEFAULT):
        model = trained(name)
        seen = measured(model, views, model.crops, seed)
        drawn = [judged(model.model, seen, keyed_generator(NAME, "tags", seed, draw)) for draw in range(draws)]
        numbers[name] = {key: float(np.mean([accuracy[key] for accuracy in drawn])) for key in drawn[0]}
    config = {"instances": len(names), "tagged_per_class": TAGGED, "draws_of_tags": draws}
    result = framed(NAME, numbers, config, quick=quick, seed=seed)
    return write_result(out, result, claims(numbers[DEFAULT]), [_table(numbers)])


def judged(
    model: LatentModel,
    views: FeatureViews,
    generator: np.random.Generator,
    class_of: Callable[[str], str] = goods_class,
) -> dict[str, float]:
    """Accuracy of every method on the instances left untagged by one draw, by views or by triples of views."""
    tags = _drawn_tags(views.names, class_of, generator)
    classes = tuple(sorted(set(tags.values())))
    truth = np.array([classes.index(class_of(name)) for name in views.names])
    untagged = ~np.isin(views.names, list(tags))
    single = np.flatnonzero(untagged[views.instance])
    triples = _triples(views, np.flatnonzero(untagged), generator)
    labels = truth[views.instance]
    tagged = DescriptorBelief(*_descriptors(model, views, tags, generator))
    grounding = ground(tuple(tags), tagged.mean, tags)
    encoded = model.encode(views.features[single])
    told = infer_descriptors(
        model,
        take(views.viewpoints, triples.ravel()),
        views.features[triples.ravel()].reshape(len(triples), VIEWS, -1),
    )
    found = {
        "gaussian_1_view": grounding.log_likelihood(encoded).argmax(axis=1),
        "gaussian_3_views": grounding.log_likelihood(told).argmax(axis=1),
        "nearest_1_view": _nearest(tags, tagged, encoded, classes),
        "nearest_3_views": _nearest(tags, tagged, told, classes),
    }
    fitted = np.flatnonzero(~untagged[views.instance])
    found |= _supervised(views, labels, fitted, single, triples, "supervised")
    accuracy = {
        name: float((guess == labels[single if name.endswith("1_view") else triples[:, 0]]).mean())
        for name, guess in found.items()
    }
    return accuracy | _with_all_labels(views, labels, single, triples, generator)


def _drawn_tags(
    names: tuple[str, ...], class_of: Callable[[str], str], generator: np.random.Generator
) -> dict[str, str]:
    of_class = defaultdict(list)
    for name in names:
        of_class[class_of(name)].append(name)
    return {
        str(name): class_name
        for class_name, members in sorted(of_class.items())
        for name in generator.choice(members, TAGGED, replace=False)
    }


def _triples(views: FeatureViews, instances: NDArray[np.int_], generator: np.random.Generator) -> NDArray[np.int_]:
    """(T, VIEWS) rows of views of one instance each, every view used once."""
    parts = []
    for index in instances:
        rows = generator.permutation(np.flatnonzero(views.instance == index))
        parts.append(rows[: len(rows) // VIEWS * VIEWS].reshape(-1, VIEWS))
    return np.concatenate(parts)


def _descriptors(
    model: LatentModel, views: FeatureViews, tags: dict[str, str], generator: np.random.Generator
) -> tuple[Array, Array]:
    """Means and sigmas of the tagged instances: as learned, or inferred from three views where they are new."""
    means, sigmas = [], []
    for name in tags:
        if name in model.instances.names:
            means.append(model.instances.descriptors[model.instances.names.index(name)])
            sigmas.append(np.zeros_like(means[-1]))
            continue
        rows = generator.choice(np.flatnonzero(views.instance == views.names.index(name)), VIEWS, replace=False)
        own = infer_descriptors(model, take(views.viewpoints, rows), views.features[rows][None])
        means.append(own.mean[0])
        sigmas.append(own.sigma[0])
    return np.array(means), np.array(sigmas)


def _nearest(
    tags: dict[str, str], tagged: DescriptorBelief, queries: DescriptorBelief, classes: tuple[str, ...]
) -> NDArray[np.int_]:
    found = nearest_class(tuple(tags), tagged.mean, tags, queries.mean)
    return np.array([classes.index(name) for name in found])


def _supervised(
    views: FeatureViews,
    labels: NDArray[np.int_],
    fitted: NDArray[np.int_],
    single: NDArray[np.int_],
    triples: NDArray[np.int_],
    name: str,
) -> dict[str, NDArray[np.int_]]:
    """Logistic regression on the features of some rows; three views count by the product of their probabilities."""
    classifier = make_pipeline(StandardScaler(), LogisticRegression(max_iter=500))
    classifier.fit(views.features[fitted], labels[fitted])
    logs = classifier.predict_log_proba(views.features)
    return {
        f"{name}_1_view": classifier.classes_[logs[single].argmax(axis=1)],
        f"{name}_3_views": classifier.classes_[logs[triples].sum(axis=1).argmax(axis=1)],
    }


def _with_all_labels(
    views: FeatureViews,
    labels: NDArray[np.int_],
    single: NDArray[np.int_],
    triples: NDArray[np.int_],
    generator: np.random.Generator,
) -> dict[str, float]:
    """Leaving out a fifth of the instances in turn: what labels for nearly everything are worth."""
    fold = generator.permutation(len(views.names)) % 5
    right: dict[str, list[bool]] = {"supervised_all_1_view": [], "supervised_all_3_views": []}
    for number in range(5):
        out = fold[views.instance] == number
        own_single, own_triples = single[out[single]], triples[out[triples[:, 0]]]
        found = _supervised(views, labels, np.flatnonzero(~out), own_single, own_triples, "supervised_all")
        for name, guess in found.items():
            rows = own_single if name.endswith("1_view") else own_triples[:, 0]
            right[name] += (guess == labels[rows]).tolist()
    return {name: float(np.mean(values)) for name, values in right.items()}


def claims(own: dict[str, float]) -> list[Claim]:
    """What grounding is worth beside supervision."""
    best = max(own["gaussian_3_views"], own["nearest_3_views"])
    return [
        Claim(
            "Two tagged instances per class ground the space: untagged instances are classified as well as by a"
            " classifier trained on the same tags",
            "Sec. 5.6.A",
            "could likely produce satisfactory results",
            f"{best:.3f} from 3 views, supervised {own['supervised_3_views']:.3f};"
            f" one view {max(own['gaussian_1_view'], own['nearest_1_view']):.3f}, {own['supervised_1_view']:.3f}",
            best >= own["supervised_3_views"],
        ),
        Claim(
            "Labels for nearly all instances are worth more",
            "project",
            "",
            f"{own['supervised_all_3_views']:.3f} from 3 views, {own['supervised_all_1_view']:.3f} from one",
            own["supervised_all_3_views"] >= best,
        ),
    ]


def _table(numbers: dict[str, dict[str, float]]) -> Table:
    rows = tuple((text, *(f"{row[name]:.3f}" for row in numbers.values())) for name, text in METHODS.items())
    title = "Accuracy on unseen views of untagged instances"
    return Table(title, ("method", *(WORDS[name] for name in numbers)), rows)
