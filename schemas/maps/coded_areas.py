"""What the codes of a raster stand for, where they become areas of a map."""

from pydantic import BaseModel, ConfigDict


class CodedAreas(BaseModel):
    """Attributes of the areas of every code, by name; codes that are not named become no area."""

    model_config = ConfigDict(frozen=True)

    attributes: dict[int, dict[str, str]]
