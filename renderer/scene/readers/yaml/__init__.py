"""Reader of Rayfarm's scene files (docs/scene-format.md), YAML or JSON, checked against the schema in renderer/scene/schema.json.

lines.py parses YAML and records the line of each value; reader.py is the entry point.
"""

from renderer.scene.readers.yaml.reader import read

__all__ = ["read"]
