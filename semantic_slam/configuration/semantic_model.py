"""What says of which class an object is: the class model, its file and its parameters."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter
from semantic_slam.registry import CLASS_MODELS


@dataclass(frozen=True)
class SemanticModelConfiguration:
    kind: str = parameter(
        "gp_independent",
        "class models of Eq. 4.2; gp_correlated: views share their errors; latent: descriptors in a learned space;"
        " detector: a detector's own labels and scores, embedding: vectors that detections carry, without training;"
        " detector_embedding: both, with the parameters of both",
        choices=CLASS_MODELS,
    )
    path: str = parameter(
        "",
        "file of the viewpoint models, or of the latent space; empty: the shipped one. detector: what semantic_slam fit"
        " --from-run wrote; empty: nothing was fitted. detector_embedding: the file says whether it is of labels or of"
        " vectors, the others keep their parameters",
    )
    path_digest: str = parameter("", "digest of the file that path must name; empty: any, a run notes which it is")
    space: str = parameter("", "latent: the space that the file must hold; empty: any, a run notes which it is")
    class_names: tuple[str, ...] = parameter(
        ("class_1", "class_2"), "two classes of the parametric model", distinct=True
    )
    likelihood_tempering: float = parameter(
        4.0,
        "gp_independent, latent: so many consecutive views tell as much as one, they repeat their errors",
        minimum=1.0,
        formerly="correlated_views",
    )
    outlier_share: float = parameter(
        0.05,
        "parametric, gp_independent, detector, embedding: share of views that tell nothing of their object; 0: there"
        " are none",
        minimum=0.0,
        maximum=0.5,
    )
    sigma_view: float = parameter(
        0.03, "gp_correlated: standard deviation of a score between views from the same direction", minimum=1e-3
    )
    num_tracks: int = parameter(200, "gp_correlated: samples of the track that a hypothesis averages over", minimum=4)
    window: int = parameter(20, "gp_correlated: views of an object that a new view is correlated with", minimum=1)
    track_average: str = parameter(
        "evidence",
        "gp_correlated: tracks count by their evidence, or evenly with normalised posteriors (thesis, Eq. 3.20)",
        choices=("evidence", "thesis"),
    )
    alpha: float = parameter(0.25, "viewpoint dependency of the parametric model (Eq. 4.22)", minimum=0.0, maximum=1.0)
    concentration: float = parameter(15.0, "K of R = K [[1, -0.5], [0, 1]]; covariance (R^T R)^-1", minimum=1e-6)
    labels: tuple[str, ...] = parameter(
        (),
        "detector: labels that objects may be named by, everything else is 'none of these'; empty: all labels of the"
        " bag, live: those that the first detections name",
    )
    label_accuracy: float = parameter(
        0.75,
        "detector: expected share of views in which a class is called by its own label",
        minimum=0.01,
        maximum=0.999,
    )
    label_counts: float = parameter(4.0, "detector: views that this expectation counts as", minimum=1e-3)
    class_counts: float = parameter(
        1.0,
        "detector: objects per class that the shares of classes before a run count as, for which class a new one is;"
        " those of the map so far count besides",
        minimum=1e-3,
    )
    count_factors: tuple[float, ...] = parameter(
        (1.0, 10.0),
        "detector: factors on label_counts: an object is confused in a way of its own, or any box by chance; which is"
        " right is inferred from all objects",
        distinct=True,
    )
    repeat_shares: tuple[float, ...] = parameter(
        (0.0, 0.5, 0.95),
        "detector: probabilities that a view from the place of an earlier one repeats its answer; the weight of each"
        " value is inferred",
        distinct=True,
    )
    score_powers: tuple[float, ...] = parameter(
        (0.0, 1.0),
        "detector: powers of the scores of a box that may be the probabilities of what it shows: 1 as they are told,"
        " below 1 of a detector surer than right, above 1 of one that is too modest, 0 the label alone counts; which is"
        " right is inferred",
        distinct=True,
    )
    repeat_rad: float = parameter(
        0.5,
        "detector, embedding: turn about the object [rad], or change of the logarithm of its distance, after which"
        " views repeat by a factor of 1 / e (embedding: of its root)",
        minimum=1e-3,
    )
    embedding_dimensions: int = parameter(
        128, "embedding: components that longer vectors are reduced to by a fixed projection", minimum=2, maximum=4096
    )
    spread_shares: tuple[float, ...] = parameter(
        (0.02, 0.05, 0.1, 0.2, 0.35, 0.55),
        "embedding: shares that the sides of one object may have in the spread of all vectors; which is right for each"
        " object is inferred, and which are usual",
        distinct=True,
    )
    noise_shares: tuple[float, ...] = parameter(
        (0.01, 0.04, 0.12),
        "embedding: shares in that spread which a view from the same place may not repeat",
        distinct=True,
    )
