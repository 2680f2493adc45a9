"""What the report says of the coloured mesh: its files, and what its textures are worth."""

from collections.abc import Iterator
from statistics import median

from orthomill.schemas.stage_report import Figure, Product
from orthomill.tasks.projection.model.model_colours import TileFacts


def model_products(whole: bool) -> Iterator[Product]:
    """The files of the model."""
    yield Product(
        path="products/model.html", purpose="The model and its photographs, to turn in a browser, without network", main=True
    )
    if whole:
        yield Product(path="products/model.glb", purpose="The model with textures, in metres from its origin", main=True)
    yield Product(path="products/model.ply", purpose="The mesh with colours of its vertices, in the project's system")
    yield Product(
        path="products/model/tileset.json", purpose="The model as 3D Tiles, from coarse to fine, for viewers of large models"
    )


def texture_figures(textures: tuple[TileFacts, ...]) -> Iterator[Figure]:
    """Figures of the model."""
    texels = max(sum(one.texels for one in textures), 1)
    yield Figure(name="model_tiles", value=len(textures), sentence="Tiles of the model, each with a texture of its own.")
    yield Figure(name="model_texels", value=texels, sentence="Texels that lie on triangles.", unit="px")
    size = median(one.texel for one in textures)
    yield Figure(name="model_texel", value=float(f"{size:.4g}"), unit="m", sentence="Median side of a texel on the surface.")
    unseen = 100 * sum(one.seen[0] for one in textures) / texels
    yield Figure(
        name="model_unseen", value=round(unseen, 2), unit="%", sentence="Texels that no photograph sees; they are grey (128)."
    )
