"""A red ball on a grey floor, as an array and, where Pillow is installed, as hello.png."""

import carom

scene = {
    "camera": {"eye": [0, -4, 2], "target": [0, 0, 0.5], "up": [0, 0, 1], "fov_x_deg": 44},
    "environment": {"radiance": [0.8, 0.9, 1.0]},
    "materials": {"red": {"diffuse": {"albedo": [0.8, 0.1, 0.1]}}, "grey": {"diffuse": {"albedo": [0.5, 0.5, 0.5]}}},
    "objects": [
        {"name": "ball", "material": "red", "shape": {"sphere": {"center": [0, 0, 0.5], "radius": 0.5}}},
        {"name": "floor", "material": "grey", "shape": {"box": {"min": [-9, -9, -0.1], "max": [9, 9, 0]}}},
    ],
}
image = carom.Farm().render(scene, (640, 360), 64)
print(image.shape, image.dtype, "mean radiance", image.mean(axis=(0, 1)))

try:
    from PIL import Image

    Image.fromarray(carom.srgb(image)).save("hello.png")
except ImportError:
    pass
