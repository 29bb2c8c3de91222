"""Learning a latent model: losses, priors, splits, the command, and its files."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from worlds.views.latent_toy import DIMENSIONS, FEATURES, INSTANCES, random_network, toy_model, toy_views

from semantic_slam.errors import InputError
from semantic_slam.latent.change_model import ChangeModel
from semantic_slam.latent.direction import NUM_INPUTS
from semantic_slam.latent.extractor import FeatureExtractor
from semantic_slam.latent.extractor_store import read_extractor
from semantic_slam.latent.latent_model import FeatureNoise, LatentModel
from semantic_slam.latent.store import read_latent_model, save_latent_model
from semantic_slam.training.latent.fitting import energy_training
from semantic_slam.training.latent.fitting.change_training import ChangeSettings, fit_change_model
from semantic_slam.training.latent.fitting.class_grounding import ground
from semantic_slam.training.latent.fitting.contrast_training import contrast
from semantic_slam.training.latent.fitting.energy_training import energy
from semantic_slam.training.latent.fitting.joint_training import CropViews, JointModel, JointSettings, train_jointly
from semantic_slam.training.latent.fitting.latent_prior import contrastive, n_pairs
from semantic_slam.training.latent.fitting.map_training import (
    EncoderSettings,
    Fitted,
    MapSettings,
    fit_encoder,
    fit_map,
)
from semantic_slam.training.latent.fitting.principal_components import principal_components
from semantic_slam.training.latent.views.feature_views import turned
from semantic_slam.training.latent.views.turntable_split import choose_held_out, split, wanted_angle
from semantic_slam.training.latent.views.view_crops import GREY, feature_views, plain_crops, room_crops
from semantic_slam.training.latent.views.view_pairs import change_peaks, changes_found, draw_pairs
from semantic_slam.training.views import ObjectView
from semantic_slam.viewpoint.model import Viewpoints

SIZE = FeatureExtractor.input_size


def striped_view(name: str, angle_deg: int, hue: int) -> ObjectView:
    """A square whose left half grows with the sine of the angle, upper half with its cosine."""
    cutout = np.full((40, 40, 3), hue, dtype=np.uint8)
    cutout[:, : round(20 + 19 * np.sin(np.deg2rad(angle_deg))), 0] = 250
    cutout[: round(20 + 19 * np.cos(np.deg2rad(angle_deg))), :, 1] = 250
    return ObjectView(name, np.deg2rad(angle_deg), 0.2, 2.0, cutout, np.full((40, 40), 255, dtype=np.uint8), angle_deg)


def striped_views(step_deg: int = 6) -> list[ObjectView]:
    return [
        striped_view(f"thing_{index}", angle, 40 * index) for index in range(3) for angle in range(0, 360, step_deg)
    ]


def crop_views(views: list[ObjectView]) -> CropViews:
    names = sorted({view.class_name for view in views})
    seen = feature_views(views, tuple(names), np.zeros((len(views), 0)))
    return CropViews(plain_crops(views, SIZE), seen.instance, seen.viewpoints, len(names))


def test_split_shows_no_test_view_to_training() -> None:
    parts = split(striped_views(3), ["thing_2"])
    angles = [{view.angle_deg for view in part} for part in (parts.train, parts.calibrate, parts.validate)]
    assert [len(part) for part in angles] == [30, 15, 15]
    assert not (angles[0] & angles[1] or angles[0] & angles[2] or angles[1] & angles[2])
    assert {view.class_name for view in parts.train} == {"thing_0", "thing_1"}
    assert {view.class_name for view in parts.held_out} == {"thing_2"}
    assert wanted_angle(18) and not wanted_angle(3)


@pytest.mark.parametrize("step_deg", [5, 10])
def test_split_of_a_table_with_other_stops_trains_at_every_other_one(step_deg: int) -> None:
    parts = split(striped_views(step_deg), [])
    angles = [{view.angle_deg for view in part} for part in (parts.train, parts.calibrate, parts.validate)]
    assert angles[0] == set(range(0, 360, 2 * step_deg))
    assert angles[1] == set(range(step_deg, 360, 4 * step_deg))
    assert angles[2] == set(range(3 * step_deg, 360, 4 * step_deg))


def test_every_instance_trains_whichever_angles_it_was_photographed_at() -> None:
    angles = {"even": range(0, 360, 12), "between": range(6, 360, 12), "coarse": range(5, 360, 30), "once": [77]}
    parts = split([striped_view(name, angle, 0) for name, own in angles.items() for angle in own], [])

    def counts(views: list[ObjectView]) -> Counter[str]:
        return Counter(view.class_name for view in views)

    assert counts(parts.train) == {"even": 15, "between": 15, "coarse": 6, "once": 1}
    assert counts(parts.calibrate) + counts(parts.validate) == {"even": 15, "between": 15, "coarse": 6}
    assert {view.angle_deg for view in parts.calibrate if view.class_name == "coarse"} == {35, 155, 275}


def test_split_of_a_table_that_stopped_seldom_is_bad_input() -> None:
    with pytest.raises(InputError, match="--step-deg 3 or 6"):
        split(striped_views(60), [])


def test_held_out_instances_leave_two_of_every_class() -> None:
    classes = {f"{kind}_{index}": kind for kind in ("box", "cup") for index in range(4)} | {"desk": "desk"}
    held_out = choose_held_out(list(classes), classes, 4, 0)
    assert sorted(classes[name] for name in held_out) == ["box", "box", "cup", "cup"]
    with pytest.raises(InputError, match="only 4"):
        choose_held_out(list(classes), classes, 5, 0)


def test_crops_are_the_same_for_a_seed_and_others_for_another() -> None:
    views = striped_views(60)[:4]
    first, again, other = (room_crops(views, SIZE, 2, seed) for seed in (1, 1, 2))
    assert first.shape == (8, SIZE, SIZE, 3)
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)
    assert np.any(first[:4] != first[4:])


def test_plain_crops_show_the_object_alone() -> None:
    view = striped_view("thing", 90, 200)
    half = replace(view, mask=np.where(np.arange(40)[:, None] < 20, view.mask, 0).astype(np.uint8))
    crop = plain_crops([half], SIZE)[0]
    assert np.all(crop[-4:] == GREY) and np.all(crop[:, :1] == GREY)
    assert np.any(crop[SIZE // 4, SIZE // 2] != GREY)


def test_principal_components_span_what_varies() -> None:
    generator = np.random.default_rng(0)
    pattern = generator.integers(0, 40, (8, 8, 3))
    crops = np.clip(100 + generator.integers(0, 4, 50)[:, None, None, None] * pattern, 0, 255).astype(np.uint8)
    targets = principal_components(crops, 2, 0).targets(crops)
    assert targets[:, 0].std() > 50.0 * targets[:, 1].std()


@pytest.mark.parametrize("prior", [contrastive, n_pairs])
def test_priors_keep_instances_apart_but_not_infinitely_far(prior: object) -> None:
    triangle = torch.tensor([[1.0, 0.0], [-0.5, 0.87], [-0.5, -0.87]])
    alike, apart, far = (float(prior(scale * triangle)) for scale in (0.01, 1.5, 50.0))  # type: ignore[operator]
    assert apart < alike and apart < far


def test_contrast_is_least_for_the_true_means() -> None:
    views = crop_views(striped_views(24))
    torch.manual_seed(0)
    model = JointModel(FeatureExtractor(8), 3, 2, (8,))
    rows = np.arange(len(views.crops))
    with torch.no_grad():
        own = model.mean(views.viewpoints, model.descriptors[torch.from_numpy(views.instance)])
        losses = [
            float(contrast(model, 30.0 * features, views, rows, np.random.default_rng(0)))
            for features in (own, own.flip(0))
        ]
    assert losses[0] < losses[1]


def test_a_bowl_has_no_energy_and_a_flat_world_some(monkeypatch: pytest.MonkeyPatch) -> None:
    """With mu = (azimuth, elevation, e) / 0.25 both quadratic forms of Eq. 5.16 agree whatever the perturbation."""
    monkeypatch.setattr(energy_training, "ORDER_WEIGHT", 0.0)
    monkeypatch.setattr(energy_training, "CONTRAST_WEIGHT", 0.0)
    views = crop_views(striped_views(24))
    rows = np.arange(len(views.crops))

    class Bowl(JointModel):
        def mean(self, viewpoints: Viewpoints, descriptors: torch.Tensor) -> torch.Tensor:
            pose = np.stack([viewpoints.azimuth_rad, viewpoints.elevation_rad], axis=1)
            return torch.cat([torch.from_numpy(pose).float(), descriptors], dim=1) / 0.25

    class Flat(JointModel):
        def mean(self, viewpoints: Viewpoints, descriptors: torch.Tensor) -> torch.Tensor:
            return torch.zeros(len(descriptors), 4)

    terms = []
    for kind in (Bowl, Flat):
        model = kind(FeatureExtractor(4), 3, 2, (8,))
        with torch.no_grad():
            features = model.mean(views.viewpoints, model.descriptors[torch.from_numpy(views.instance)])
            terms.append(float(energy(model, features, views, rows, np.random.default_rng(0))))
    # Of four sets, three move two pose components and one two of the descriptor too: 1/2 (0 + 2 + 2 + 4) / 4 = 1.
    assert terms[0] < 1e-3
    assert terms[1] == pytest.approx(1.0, abs=0.25)


def test_rescaling_to_the_bowl_keeps_what_views_are_told_apart_by() -> None:
    views = crop_views(striped_views(24))
    torch.manual_seed(0)
    model = JointModel(FeatureExtractor(8), 3, 2, (16,))
    rows = np.arange(len(views.crops))

    def loss() -> float:
        torch.manual_seed(1)
        with torch.no_grad():
            return float(contrast(model, model.features(views.crops), views, rows, np.random.default_rng(0)))

    before = loss()
    energy_training.rescale_to_bowl(model, views)
    assert loss() == pytest.approx(before, rel=1e-3)
    e = model.descriptors[torch.from_numpy(views.instance)]
    with torch.no_grad():
        step = model.mean(turned(views.viewpoints, 0.05), e) - model.mean(views.viewpoints, e)
    # The bowl's slope is one sigma in a quarter of a radian.
    assert float(step.norm(dim=1).median()) == pytest.approx(0.05 / 0.25, rel=1e-3)


def test_the_ordering_term_wants_features_ordered_as_pictures() -> None:
    generator = np.random.default_rng(0)
    crops = generator.integers(0, 255, (40, SIZE, SIZE, 3), dtype=np.uint8) // np.arange(1, 41)[:, None, None, None]
    pixels = torch.from_numpy(crops.reshape(40, -1)).float()
    terms = []
    for features in (pixels / 255.0, torch.rand(40, 8, generator=torch.Generator().manual_seed(0))):
        torch.manual_seed(0)
        terms.append(float(energy_training._order_term(features, crops.astype(np.uint8))))
    assert terms[0] < 0.01 < terms[1]


@pytest.mark.slow
def test_training_jointly_lowers_the_loss_and_moves_every_part() -> None:
    views = crop_views(striped_views(24))
    torch.manual_seed(0)
    model = JointModel(FeatureExtractor(8), 3, 2, (16,))
    before = {name: value.clone() for name, value in model.named_parameters()}
    rows = np.arange(len(views.crops))

    def loss() -> float:
        with torch.no_grad():
            return float(contrast(model, model.features(views.crops), views, rows, np.random.default_rng(0)))

    start = loss()
    train_jointly(model, views, contrast, JointSettings(epochs=14, batch_size=15))
    assert loss() < 0.8 * start
    assert all(torch.any(value != before[name]) for name, value in model.named_parameters())
    assert not any(value.requires_grad for value in model.parameters())


@pytest.mark.slow
def test_maximum_posterior_fits_features_and_encoder_recovers_descriptors() -> None:
    views = toy_views(toy_model(), per_instance=60, sigma=0.02)
    generator = np.random.default_rng(5)
    sizes = (NUM_INPUTS + DIMENSIONS, 24, views.features.shape[1])
    start = Fitted(random_network(generator, sizes), 0.3 * generator.normal(size=(INSTANCES, DIMENSIONS)))
    fitted = fit_map(views, start, MapSettings(steps=400, learning_rate=2e-2, batch_size=128))
    model = toy_model()
    guess = replace(model, decoder=fitted.decoder, instances=replace(model.instances, descriptors=fitted.descriptors))
    errors = views.features - guess.mean(views.viewpoints, fitted.descriptors[views.instance])
    assert np.sqrt((errors**2).mean()) < 0.4 * views.features.std(axis=0).mean()
    encoder = fit_encoder(views, fitted.descriptors, EncoderSettings(steps=300))
    means = replace(guess, encoder=encoder).encode(views.features).mean
    nearest = np.linalg.norm(means[:, None] - fitted.descriptors, axis=-1).argmin(axis=1)
    assert (nearest == views.instance).mean() > 0.6


@pytest.mark.slow
def test_tags_pull_instances_of_a_class_together() -> None:
    views = toy_views(toy_model(), per_instance=20)
    generator = np.random.default_rng(5)
    sizes = (NUM_INPUTS + DIMENSIONS, 16, views.features.shape[1])
    start = Fitted(random_network(generator, sizes), generator.normal(size=(INSTANCES, DIMENSIONS)))
    tags = {name: "first" if index < 3 else "second" for index, name in enumerate(views.names)}
    settings = MapSettings(steps=150, learning_rate=1e-2, prior_weight=5.0, batch_size=128)

    def spread_within(known: dict[str, str]) -> float:
        descriptors = fit_map(views, start, settings, known).descriptors
        groups = [descriptors[:3], descriptors[3:]]
        return float(np.mean([group.var(axis=0).sum() for group in groups]) / descriptors.var(axis=0).sum())

    assert spread_within(tags) < spread_within({})


@pytest.mark.slow
def test_changes_of_viewpoint_are_seen_without_any_pose() -> None:
    """Features (cos, sin) of each azimuth plus an instance's own: a change turns them, wherever the front is."""
    views = toy_views(toy_model(), per_instance=60)
    azimuth = views.viewpoints.azimuth_rad
    ring = np.column_stack([np.cos(azimuth), np.sin(azimuth), views.instance / 3.0])
    views = views.with_features(ring + 0.02 * np.random.default_rng(0).normal(size=ring.shape))
    model = fit_change_model(views, ChangeSettings(hidden=(48, 48), steps=700, batch_size=128))
    first, second = draw_pairs(views, 100, np.pi, np.random.default_rng(1))
    assert np.all(views.instance[first] == views.instance[second])
    errors = np.abs(change_peaks(model, views, first, second))
    assert (errors < np.deg2rad(10.0)).mean() > 0.9
    found = changes_found(model, views, np.random.default_rng(1))
    assert found["change_peak_within_10deg"] > 0.9


def test_changes_that_no_two_views_show_have_no_share() -> None:
    model = ChangeModel(random_network(np.random.default_rng(0), (FEATURES + NUM_INPUTS, 4, 2 * FEATURES)))
    views = toy_views(toy_model(), per_instance=6)
    azimuths = np.tile(np.deg2rad(np.arange(6) * 60.0 - 150.0), INSTANCES)
    far = replace(views, viewpoints=replace(views.viewpoints, azimuth_rad=azimuths))
    assert set(changes_found(model, far, np.random.default_rng(0))) == {"change_peak_within_10deg"}
    assert changes_found(model, far.chosen(np.arange(len(far)) % 6 == 0), np.random.default_rng(0)) == {}


def test_file_round_trip_and_extractor(tmp_path: Path) -> None:
    model = toy_model()
    grounding = ground(model.instances.names, model.instances.descriptors, {"thing_0": "a", "thing_1": "b"})
    changes = ChangeModel(random_network(np.random.default_rng(0), (FEATURES + NUM_INPUTS, 4, 2 * FEATURES)))
    model = replace(model, grounding=grounding, changes=changes, provenance={"report": {"x": 1.0}})
    torch.manual_seed(0)
    extractor = FeatureExtractor(model.num_features).eval()
    path = tmp_path / "model.safetensors"
    save_latent_model(model, {name: value.numpy() for name, value in extractor.state_dict().items()}, path)
    back = read_latent_model(path)
    views = toy_views(model)
    np.testing.assert_allclose(
        back.predict(views.viewpoints, model.instances.descriptors[views.instance]).mean,
        model.mean(views.viewpoints, model.instances.descriptors[views.instance]),
        atol=1e-5,
    )
    assert back.class_names == ("a", "b") and back.provenance == model.provenance
    step = np.full((2, 2), 0.3)
    np.testing.assert_allclose(
        back.changes.predict(views.features[:2], step).mean, changes.predict(views.features[:2], step).mean, atol=1e-5
    )
    crops = np.random.default_rng(0).integers(0, 255, (3, SIZE, SIZE, 3), dtype=np.uint8)
    np.testing.assert_array_equal(read_extractor(path).features(crops), extractor.features(crops))


def test_the_name_of_a_space_follows_from_what_descriptors_mean(tmp_path: Path) -> None:
    """Noise and classes may be found anew; another decoder or extractor makes another space."""
    model, extractor = toy_model(), {"head.bias": np.zeros(FEATURES, dtype=np.float32)}

    def space(model: LatentModel, extractor: dict[str, np.ndarray]) -> str:
        save_latent_model(model, extractor, tmp_path / "model.safetensors")
        return read_latent_model(tmp_path / "model.safetensors").space

    own = space(model, extractor)
    assert own.startswith("latent-")
    assert space(replace(model, noise=FeatureNoise(np.ones(FEATURES), 3.0)), extractor) == own
    assert space(toy_model(seed=1), extractor) != own
    assert space(model, {"head.bias": np.ones(FEATURES, dtype=np.float32)}) != own


@pytest.mark.parametrize("fault", ["text", "foreign", "missing", "not finite", "absent"])
def test_bad_files_are_one_line_of_bad_input(tmp_path: Path, fault: str) -> None:
    path = tmp_path / "model.safetensors"
    if fault == "text":
        path.write_text("no weights at all")
    elif fault == "foreign":
        save_file({"x": np.zeros(2)}, str(path))
    elif fault in ("missing", "not finite"):
        model = toy_model()
        if fault == "not finite":
            model.instances.descriptors[0, 0] = np.nan
        save_latent_model(model, {}, path)
        if fault == "missing":
            description = {"schema_version": 1, "kind": "latent_descriptor"}
            save_file({"x": np.zeros(2)}, str(path), metadata={"semantic_slam": json.dumps(description)})
    with pytest.raises(InputError) as error:
        read_latent_model(path)
    assert str(path) in str(error.value) and "train_latent_model" in str(error.value)
    assert "\n" not in str(error.value)


def test_extractor_that_is_not_there_is_bad_input(tmp_path: Path) -> None:
    save_latent_model(toy_model(), {}, tmp_path / "model.safetensors")
    with pytest.raises(InputError, match="extractor"):
        read_extractor(tmp_path / "model.safetensors")
