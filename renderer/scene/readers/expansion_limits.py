"""Limits how far files may expand by internal references.

The expanded elements are counted before a library follows the references and runs out of memory.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import TypeVar
from xml.etree import ElementTree

from renderer.errors import SceneError
from renderer.sentences import Sentence

__all__ = ["check_expansion", "collada_nodes", "x3d_nodes"]

MAX_NODES = 500_000
MAX_DEPTH = 500

_WITH_NODES = ("library_nodes", "library_visual_scenes", "visual_scene", "node")

Key = TypeVar("Key", bound=Hashable)


def check_expansion(
    root: Key, below: Callable[[Key], Iterable[Key]], file: str, max_elements: int = MAX_NODES, is_circle_error: bool = True
) -> int:
    """Returns the number of elements that `root` expands to, each counted once per reference.

    below: returns the elements that an element contains or refers to. is_circle_error: whether cycles raise SceneError; False if
    the library breaks cycles itself. Raises SceneError also if there are too many elements or they are nested too deeply.
    """
    sizes: dict[Key, int] = {}
    path: list[tuple[Key, Iterator[Key]]] = [(root, iter(below(root)))]
    counts, within = [1], {root}
    while path:
        key, rest = path[-1]
        child = next(rest, None)
        if child is None:
            path.pop()
            within.discard(key)
            sizes[key] = counts.pop()
            if sizes[key] > max_elements:
                raise SceneError(
                    Sentence(
                        "node-references-too-many",
                        "{file}: its node references show more than {most} nodes; reduce them",
                        file=file,
                        most=max_elements,
                    )
                )
            if counts:
                counts[-1] += sizes[key]
        elif child in sizes:
            counts[-1] += sizes[child]
        elif child in within and not is_circle_error:
            continue
        elif child in within:
            raise SceneError(
                Sentence(
                    "nodes-contain-each-other",
                    "{file}: its nodes contain each other; export it again",
                    file=file,
                )
            )
        else:
            if len(path) >= MAX_DEPTH:
                raise SceneError(
                    Sentence(
                        "nodes-nested-too-deep",
                        "{file}: its nodes are nested more than {most} levels deep. Flatten its hierarchy",
                        file=file,
                        most=MAX_DEPTH,
                    )
                )
            path.append((child, iter(below(child))))
            counts.append(1)
            within.add(child)
    return sizes[root]


def collada_nodes(root: ElementTree.Element, file: str) -> int:
    """Returns the number of nodes of a Collada file after expansion of library references.

    Raises SceneError as `check_expansion` does.
    """
    known: dict[str, ElementTree.Element] = {}
    for node in root.iter():
        if _tag(node) in ("node", "visual_scene"):
            for name in (node.get("id"), node.get("name")):
                if name:
                    known.setdefault(name, node)

    def children(node: ElementTree.Element) -> Iterator[ElementTree.Element]:
        for child in node:
            if _tag(child) in _WITH_NODES:
                yield child
            elif _tag(child) == "instance_node" and (found := known.get((child.get("url") or "").lstrip("#"))) is not None:
                yield found

    return check_expansion(root, children, file)


def x3d_nodes(root: ElementTree.Element, file: str) -> int:
    """Returns the number of elements of an X3D file after expansion of USE references.

    Raises SceneError as `check_expansion` does.
    """
    known = {name: node for node in root.iter() if (name := node.get("DEF"))}

    def children(node: ElementTree.Element) -> Iterator[ElementTree.Element]:
        used = known.get(node.get("USE") or "")
        return iter(node) if used is None else iter((used,))

    return check_expansion(root, children, file, max(MAX_NODES, sum(1 for _ in root.iter())))


def _tag(element: ElementTree.Element) -> str:
    tag = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""
