"""Every setting that names a file is of the type that has it checked."""

from typing import Any, get_args

from pydantic import BaseModel

from orthomill.schemas.project import MapSurface, PhotoFolder, PhotoList, Project
from orthomill.schemas.project_paths import FileRole, ProjectMap, ProjectPath, file_roles, words_of
from orthomill.schemas.settings import Settings
from orthomill.tasks.catalogue import STAGES


class Several(Settings):
    one: ProjectPath
    perhaps: ProjectMap | None = None
    some: tuple[ProjectPath, ...] = ()
    text: str = ""


def test_fields_that_name_files_are_found_by_their_type():
    assert file_roles(Several) == {"one": FileRole(), "perhaps": FileRole(is_map=True), "some": FileRole()}


def test_a_word_in_the_place_of_a_file_is_no_file():
    assert words_of(MapSurface, "area") == {"auto"} and words_of(Several, "one") == frozenset()


def models(annotation: Any) -> set[type[BaseModel]]:
    """All models that a type is made of."""
    found = {annotation} if isinstance(annotation, type) and issubclass(annotation, BaseModel) else set()
    return found.union(*(models(part) for part in get_args(annotation)))


def everything() -> set[type[BaseModel]]:
    """All models that a workflow file can contain."""
    found: set[type[BaseModel]] = set()
    waiting: set[type[BaseModel]] = {Project, *STAGES}
    while waiting:
        found |= waiting
        waiting = {one for model in waiting for field in model.model_fields.values() for one in models(field.annotation)} - found
    return found


def test_no_setting_whose_sentence_speaks_of_the_projects_root_escapes_the_check():
    own = (PhotoFolder, PhotoList)  # checked as photographs
    missed = [
        f"{model.__name__}.{name}"
        for model in everything()
        if not issubclass(model, own)
        for name, field in model.model_fields.items()
        if "relative to the project's root" in (field.description or "") and name not in file_roles(model)
    ]
    assert not missed
