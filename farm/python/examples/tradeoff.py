"""Error against time: what samples and denoising buy on this machine.

    python tradeoff.py [scene.json] [width height]

Prints a table, and draws it as tradeoff.png where matplotlib is installed. The error is the relative mean squared error
against a picture of 4096 samples; its own noise adds about a 4096th of one sample's to each figure.
"""

import sys
import time

import numpy as np

import carom

REFERENCE_SPP = 4096
SAMPLES = [1, 2, 4, 8, 16, 32, 64, 128]


def rel_mse(image, reference):
    """Mean over pixels and channels of the squared error over the squared reference, which 0.01 keeps from 0."""
    return float(np.mean((image - reference) ** 2 / (reference**2 + 0.01)))


def main():
    path = sys.argv[1] if len(sys.argv) > 1 else "assets/scenes/pool.json"
    size = (int(sys.argv[2]), int(sys.argv[3])) if len(sys.argv) > 3 else (240, 135)
    scene = carom.Scene(path)
    rows = []
    with carom.Farm() as farm:
        reference = farm.render(scene, size, REFERENCE_SPP, seed=1)
        for denoise in (False, True):
            for spp in SAMPLES:
                begun = time.perf_counter()
                image = farm.render(scene, size, spp, seed=2, denoise=denoise)
                secs = time.perf_counter() - begun
                rows.append((denoise, spp, secs, rel_mse(image, reference)))
    print(f"{path}, {size[0]}x{size[1]}, against {REFERENCE_SPP} samples")
    print("denoised  spp        ms      relMSE")
    for denoise, spp, secs, error in rows:
        print(f"{'yes' if denoise else 'no':8} {spp:4} {1e3 * secs:9.1f}  {error:10.2e}")
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        return
    for denoise in (False, True):
        line = [(secs, error) for of, _, secs, error in rows if of == denoise]
        plt.loglog(*zip(*line), marker="o", label="denoised" if denoise else "as traced")
    plt.xlabel("seconds")
    plt.ylabel("relMSE")
    plt.legend()
    plt.savefig("tradeoff.png", dpi=150)


if __name__ == "__main__":
    main()
