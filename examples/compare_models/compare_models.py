"""All pixel models on the same frames: number of events, and their distance from PECS' own (docs/reference/metrics.md).

python examples/compare_models/compare_models.py
"""

import numpy as np
import pecs


def simulate_all() -> dict[str, np.ndarray]:
    """The events of every model, and of `pecs` with another seed (the key "pecs, seed 1")."""
    t_us = 1000.0 * np.arange(60)
    x = np.arange(320) - 0.8 * np.arange(60)[:, None]  # below one pixel a frame, so that no pixel is skipped
    bar = 0.1 + 0.7 * np.clip(30.5 - abs(x - 70), 0, 1)  # edges are smooth over a pixel
    frames = np.repeat(bar[:, None, :], 240, axis=1).astype(np.float32)
    models = {"pecs, seed 1": {"seed": 1}} | {m["name"]: {"model": m["name"], "seed": 2} for m in pecs.models()}
    return {name: pecs.simulate(frames, t_us, **options) for name, options in models.items()}


def main() -> None:
    events = simulate_all()
    reference = events.pop("pecs, seed 1")
    print(f"{'model':<10}{'events':>10}{'ON':>7}{'Chamfer':>10}{'Gaussian':>10}")
    for name, found in events.items():
        d = pecs.compare(reference, found, split_half=False)
        print(f"{name:<10}{len(found):>10}{found['p'].mean():>7.2f}{d['chamfer']:>10.3f}{d['gaussian']:>10.4f}")


if __name__ == "__main__":
    main()
