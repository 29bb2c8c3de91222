"""A robot lost among identical pillars drives until it knows where it is: python examples/engine.py [NEW.png]"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior, ObjectPrior

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("picture", nargs="?", type=argparse.FileType("xb"), metavar="NEW.png")  # never over another
picture = arguments.parse_args().picture
PILLARS = np.array([(x, y) for x in range(0, 24, 4) for y in (-1.5, 1.5)] + [(13.0, -1.5)])
START, STEP, SHOWN = np.array([2.0, 0.0]), (1.0, 0.0, 0.0), (0, 4, 9)
noise, paths = np.random.default_rng(3), dict[int, list[np.ndarray]]()
known = MapPrior(tuple(ObjectPrior.planar(n, x, y, sigma_m=0.05, sigma_rad=0.1) for n, (x, y) in enumerate(PILLARS)))
lost = {"initial_pose": (8.0, 0.5, 0.0), "initial_covariance": np.diag([8.0, 0.5, 0.1]) ** 2}
engine = Engine(Configuration.of(semantic_model={"kind": "none"}), known, **lost)
figure, axes = plt.subplots(len(SHOWN), figsize=(10, 7.5), sharex=True, sharey=True, layout="constrained")
for k in range(max(SHOWN) + 1):
    robot = START + np.array(STEP[:2]) * k
    seen = [Detection.at(x, y) for x, y in PILLARS - robot + noise.normal(0, 0.05, PILLARS.shape) if 0 < x < 3.5]
    belief = engine.process(Keyframe.planar(k, motion=STEP if k else (0, 0, 0), detections=seen))
    paths = {h.hypothesis_id: [*paths.get(h.parent_id, []), h.position] for h in belief.hypotheses}
    print(f"{k}: {len(seen)} detections, weights", [round(h.weight, 2) for h in belief.hypotheses[:5]])
    if k not in SHOWN:
        continue
    ax = axes[SHOWN.index(k)]
    ax.plot(*PILLARS.T, "s", color="0.6", markersize=11, label="pillars, all alike")
    ax.plot(*robot, "kx", markersize=12, markeredgewidth=2, zorder=4, label="true position")
    for h in belief.hypotheses:
        x, y, path = *h.position[:2], np.array(paths[h.hypothesis_id])
        variances, axis = np.linalg.eigh(h.covariance[:2, :2])
        (height, width), angle = 2 * np.sqrt(5.99 * variances), np.degrees(np.arctan2(*axis[::-1, 1]))  # 95 %
        color = plt.colormaps["viridis"](0.045 * (path[0, 0] + 2))  # by where it began
        ax.plot(*path.T[:2], ".-", color=color, linewidth=1 + 4 * h.weight)
        ax.add_patch(Ellipse((x, y), width, height, angle=angle, color=color, alpha=0.4))
        ax.annotate(f"{h.weight:.0%}", (x, y + 0.45), ha="center", color=color, weight="bold")
    ax.set(title=f"hypotheses after keyframe {k}", xlabel="x [m]", ylabel="y [m]", aspect="equal", ylim=(-2.6, 2.6))
axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False)
plt.savefig(picture, dpi=110) if picture else plt.show()
