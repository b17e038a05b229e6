"""Our own scene file (docs/scene-format.md): YAML, and so JSON, held to the schema in renderer/scene/schema.json.

lines.py knows where each value stands; reader.py puts the parts together that the others read.
"""

from renderer.scene.readers.yaml.reader import read

__all__ = ["read"]
