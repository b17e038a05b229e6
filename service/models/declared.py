"""Fields of the API's models, generated from the setting declarations in renderer/settings.py.

Each has the declaration's type, range, names, default and description.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, Field, create_model

from renderer.errors import SettingsError
from renderer.setting_declaration import MAX_NAME, DeclaredSetting
from renderer.setting_docs import sentences

__all__ = ["with_fields"]

Model = TypeVar("Model", bound=BaseModel)


def with_fields(settings: Mapping[str, DeclaredSetting], of_scene: bool = False) -> Callable[[type[Model]], type[Model]]:
    """Decorator that adds these settings to a model as fields. Replaces the fields that the class declares for the type checker.

    of_scene: if the request omits a field, the scene file's value is used, or else the setting's default.
    """

    def add(model: type[Model]) -> type[Model]:
        made: dict[str, Any] = {name: _field(each, of_scene) for name, each in settings.items()}
        return create_model(model.__name__, __base__=model, __module__=model.__module__, __doc__=model.__doc__, **made)

    return add


def _field(each: DeclaredSetting, of_scene: bool) -> tuple[Any, Any]:
    number: Any = Annotated[each.number, Field(ge=each.lowest, le=each.setting.high, allow_inf_nan=False)]
    kind: Any = tuple[number, number, number] if each.kind is tuple else number
    names: list[Any] = list(each.setting.choices or ())
    if each.setting.names is not None:
        kind = Annotated[str, Field(max_length=(MAX_NAME + 2) * each.setting.names)]
    kind = Annotated[str if names else kind, AfterValidator(_validator(each))]
    default: Any = ... if each.default is MISSING else each.default
    if of_scene or each.optional:
        kind, default = kind | None, None
        names += [None] if names else []
    schema: dict[str, Any] | None = {"enum": names} if names else None
    return kind, Field(default, description=sentences(each), json_schema_extra=schema)


def _validator(each: DeclaredSetting) -> Callable[[Any], Any]:
    def check(value: Any) -> Any:
        try:
            return each.check(value)
        except SettingsError as error:
            raise ValueError(str(error)) from None

    return check
