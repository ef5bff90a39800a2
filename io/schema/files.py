"""Files that a scene names."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo

from periporo.io.schema.base import FileName


def _existing_file(name: Any, info: ValidationInfo) -> Any:
    """The absolute path of a file that a scene names relative to its own folder."""
    if not isinstance(name, str) or not name.isprintable() or not name:
        return name  # for the next validator to refuse
    path = Path((info.context or {}).get("folder", "."), name)
    try:
        found = path.is_file()
    except OSError as error:
        raise ValueError(f"the file cannot be read: {error.strerror}") from None
    if not found:
        raise ValueError(f"there is no regular file {path}")
    return str(path.resolve())


ExistingFile = Annotated[FileName, Field(max_length=4096), BeforeValidator(_existing_file)]
