"""Reader for our scene files (docs/scene-format.md): YAML, and so JSON, checked against the schema in renderer/scene/schema.json.

lines.py records the line of each value; reader.py is the driver.
"""

from renderer.scene.readers.yaml.reader import read

__all__ = ["read"]
