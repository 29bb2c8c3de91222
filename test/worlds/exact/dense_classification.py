"""Random problems of chapter 3: their answers are exact, from whole matrices that share nothing with the package."""

from typing import Any

import numpy as np
from scipy.stats import multivariate_normal

KINDS = ("plain", "diagonal", "one_sample", "arbitrary", "simplex", "extreme", "dense", "repeated")


def problem(kind: str, test_noise: str, seed: int, num_views: int = 6) -> dict[str, Any]:
    """A random problem in the form of a fixture's input; ``kind`` is one of KINDS."""
    generator = np.random.default_rng([KINDS.index(kind), seed])
    classes, size = (3, 3) if kind in ("simplex", "extreme") else (2, 2) if kind == "plain" else (3, 2)
    step = 0.6 if kind == "dense" else 2.0
    X = np.cumsum(generator.normal(scale=step, size=(num_views, 2)), axis=0)
    if kind == "repeated":
        X[3:] = X[:3] + 1e-3 * generator.normal(size=(num_views - 3, 2))
    samples = [_cloud(kind, size, generator) for _ in X]
    sigma = [np.cov(z.T) if len(z) > 1 else np.zeros((size, size)) for z in samples]
    mu = [z.mean(axis=0) for z in samples]
    if kind == "diagonal":
        sigma = [np.diag(np.diag(s)) for s in sigma]
    if kind == "arbitrary":
        mu = [5.0 * generator.normal(size=size) for _ in X]
        roots = [generator.normal(size=(size, size)) for _ in X]
        sigma = [root @ root.T for root in roots]
    given = {
        "classes": [_model(generator, size) for _ in range(classes)],
        "prior": generator.dirichlet(np.ones(classes)),
        "X": X,
        "samples": samples,
        "mu_z": np.array(mu),
        "Sigma_z": np.array(sigma),
        "test_noise": test_noise,
        "gt": 0,
        "simple_bayes_eps": 0.01,
        "model_based_measurement": "mean of samples",
        "pose_samples": X + generator.normal(scale=0.5, size=(4, num_views, 2)),
    }
    return {name: _plain(value) for name, value in given.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def _model(generator: np.random.Generator, size: int) -> dict[str, Any]:
    roots = generator.normal(scale=0.3, size=(size, 2, 2))
    return {
        "X_T": generator.normal(scale=3.0, size=(9, 2)),
        "S_T": generator.random((9, size)),
        "sigma2": generator.uniform(0.05, 0.2, size),
        "L": 4.0 * np.eye(2) + roots @ roots.swapaxes(1, 2),
        "sigma_n": generator.uniform(0.03, 0.06, size),
    }


def _cloud(kind: str, size: int, generator: np.random.Generator) -> np.ndarray:
    count = 1 if kind == "one_sample" else int(generator.integers(size + 1, 9))
    if kind == "simplex":
        return generator.dirichlet(np.ones(size), count)
    if kind == "extreme":
        corner = np.eye(size)[generator.integers(size)]
        return np.abs(corner - 1e-5 * generator.random((count, size)))
    return generator.normal(generator.random(size), 0.1, size=(count, size))


class Dense:
    """Answers to a problem, under the names of a fixture's."""

    def __init__(self, given: dict[str, Any], X: np.ndarray | None = None) -> None:
        self.given, self.X = given, np.array(given["X"]) if X is None else X
        self.mu, self.sigma = np.array(given["mu_z"]), np.array(given["Sigma_z"])
        self.samples = [np.array(z) for z in given["samples"]]
        self.log_prior = np.log(given["prior"])
        parts = [self._process(row) for row in given["classes"]]
        self.mean = np.array([mean for mean, _ in parts])  # (C, K, F)
        self.cov = np.array([cov for _, cov in parts])  # (C, F, K, K)

    def _process(self, row: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        T, S = np.array(row["X_T"]), np.array(row["S_T"])
        means, covariances = [], []
        for f, (s2, L, noise) in enumerate(zip(row["sigma2"], row["L"], row["sigma_n"], strict=True)):

            def kernel(a: np.ndarray, b: np.ndarray, s2: float = s2, L: list = L) -> np.ndarray:
                d = a[:, None] - b[None]
                return s2 * np.exp(-0.5 * np.einsum("abi,ij,abj->ab", d, np.linalg.inv(L), d))

            H = np.linalg.inv(kernel(T, T) + noise**2 * np.eye(len(T)))
            own = noise**2 * np.eye(len(self.X)) if self.given["test_noise"] == "sigma_n" else 0.0
            means.append(kernel(self.X, T) @ H @ S[:, f])
            covariances.append(kernel(self.X, self.X) - kernel(self.X, T) @ H @ kernel(T, self.X) + own)
        return np.array(means).T, np.array(covariances)

    def stacked(self, c: int, views: slice) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of all scores of the views, view by view."""
        mean = self.mean[c, views].ravel()
        count, size = self.mean[c, views].shape
        cov = np.zeros((count, size, count, size))
        for f in range(size):
            cov[:, f, :, f] = self.cov[c, f, views, views]
        return mean, cov.reshape(mean.size, mean.size)

    def noise(self, views: slice) -> np.ndarray:
        """Block-diagonal Sigma_z of the views."""
        blocks = self.sigma[views]
        count, size = blocks.shape[:2]
        whole = np.zeros((count, size, count, size))
        for i, block in enumerate(blocks):
            whole[i, :, i] = block
        return whole.reshape(count * size, count * size)

    def prediction(self, c: int, k: int, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Of the scores at view k from the measurements of views first..k-1 (Eq. 3.29)."""
        mean, cov = self.stacked(c, slice(first, k + 1))
        split = -self.mean.shape[2]
        omega = np.linalg.solve(cov[:split, :split], cov[:split, split:]).T if k > first else np.zeros((-split, 0))
        shift = omega @ (self.mu[first:k].ravel() - mean[:split])
        own = cov[split:, split:] - omega @ cov[:split, split:]
        return mean[split:] + shift, own + omega @ self.noise(slice(first, k)) @ omega.T

    def recursion(self, window: int | None = None) -> dict[str, Any]:
        """Alg. 3.1 for one track."""
        log_posterior = self.log_prior
        found: dict[str, Any] = {"step_mean": [], "step_cov": [], "step_loglik": [], "log_posterior": []}
        for k, samples in enumerate(self.samples):
            first = max(0, k - window) if window else 0
            moments = [self.prediction(c, k, first) for c in range(len(self.log_prior))]
            logs = np.array([_log_density(samples, mean, cov) for mean, cov in moments]).T  # (n, C)
            each = logs + log_posterior
            each -= np.logaddexp.reduce(each, axis=1, keepdims=True)
            log_posterior = np.logaddexp.reduce(each, axis=0) - np.log(len(samples))
            found["step_mean"].append([mean for mean, _ in moments])
            found["step_cov"].append([cov for _, cov in moments])
            found["step_loglik"].append(logs)
            found["log_posterior"].append(log_posterior)
        return found

    def joint(self, measurements: np.ndarray, noisy: bool) -> np.ndarray:
        """(K, C) log posteriors of all prefixes."""
        rows = []
        for k in range(len(self.X)):
            views = slice(0, k + 1)
            logs = []
            for c in range(len(self.log_prior)):
                mean, cov = self.stacked(c, views)
                noise = self.noise(views) if noisy else 0.0
                logs.append(_log_density(measurements[views].reshape(1, -1), mean, cov + noise)[0])
            row = np.array(logs) + self.log_prior
            rows.append(row - np.logaddexp.reduce(row))
        return np.array(rows)

    def answers(self) -> dict[str, Any]:
        """Everything a fixture of this input would hold."""
        means = np.array([z.mean(axis=0) for z in self.samples])
        found = self.recursion()
        expected = {
            "gp_mean": self.mean,
            "gp_cov": self.cov,
            **found,
            "posterior": np.exp(found["log_posterior"]),
            "joint_log_posterior": self.joint(self.mu, noisy=True),
            "model_based_log_posterior": self.joint(means, noisy=False),
        }
        tracks = [Dense(self.given, np.array(track)).recursion() for track in self.given["pose_samples"]]
        each = np.array([track["log_posterior"] for track in tracks])
        expected["log_posterior_localisation"] = np.logaddexp.reduce(each) - np.log(len(each))
        expected["log_posterior_per_pose_sample_final"] = each[:, -1]
        return _plain({name: np.array(v) if name != "step_loglik" else list(v) for name, v in expected.items()})


def _log_density(samples: np.ndarray, mean: np.ndarray, cov: np.ndarray) -> np.ndarray:
    return np.atleast_1d(multivariate_normal(mean, cov, allow_singular=False).logpdf(samples))
