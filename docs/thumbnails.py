"""Writes docs/thumbnails from the notebooks of `make docs`: `python docs/thumbnails.py`."""

import base64
import io
from pathlib import Path

import jupyter_cache
from PIL import Image

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "thumbnails"

if __name__ == "__main__":
    cache = jupyter_cache.get_cache(ROOT / "build" / ".jupyter_cache")
    for record in cache.list_cache_records():
        path = Path(record.uri)
        if path.suffix != ".py":
            continue
        outputs = [
            o for c in cache.get_cache_bundle(record.pk).nb.cells for o in c.get("outputs", ())
        ]
        *_, last = (o["data"]["image/png"] for o in outputs if "image/png" in o.get("data", {}))
        image = Image.open(io.BytesIO(base64.b64decode(last))).convert("RGB")
        image.thumbnail((320, 240))
        image.quantize(64).save(FOLDER / f"{path.name[:2]}.png", optimize=True)
