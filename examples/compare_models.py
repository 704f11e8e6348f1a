"""All pixel models on the same frames: how many events, and how far from PECS' own (docs/reference/metrics.md).

python examples/compare_models.py
"""

import pecs
from simulate_frames import moving_bar


def main() -> None:
    frames = moving_bar()
    t_us = [1000.0 * i for i in range(len(frames))]
    reference = pecs.simulate(frames, t_us, seed=1)
    print(f"{'model':<10}{'events':>10}{'ON':>7}{'Chamfer':>10}{'Gaussian':>10}")
    for model in [m["name"] for m in pecs.models()]:
        events = pecs.simulate(frames, t_us, model=model, seed=2)
        d = pecs.compare(reference, events, split_half=False)
        print(f"{model:<10}{len(events):>10}{events['p'].mean():>7.2f}{d['chamfer']:>10.3f}", end="")
        print(f"{d['gaussian']:>10.4f}")


if __name__ == "__main__":
    main()
