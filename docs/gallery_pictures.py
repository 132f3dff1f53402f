"""The pictures of the gallery: those that an example writes to out/examples."""

import shutil
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst


def take_pictures(_block: Any, block_vars: Any, gallery_conf: Any) -> str:
    """Move what the example has written into the gallery; an image scraper of sphinx-gallery."""
    taken = []
    for picture in sorted(Path("out/examples").glob("*.png")):
        taken.append(next(block_vars["image_path_iterator"]))
        shutil.move(picture, taken[-1])
    return str(figure_rst(taken, gallery_conf["src_dir"]))
