"""Deforms meshes by UsdSkel's skeletons and blend shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Usd, UsdGeom, UsdSkel

from renderer.scene.description import F32
from renderer.scene.matrices import Matrix
from renderer.scene.origin import in_exact_type
from renderer.scene.readers.usd import primvars
from renderer.scene.readers.usd.meshes import Shape
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.prims import PlacedPrim, matrix
from renderer.sentences import Sentence, first_items

__all__ = ["Skeletons"]

F64 = npt.NDArray[np.float64]


class Skeletons:
    """The skeletons of a stage at a moment, and the meshes bound to them."""

    def __init__(self, time: Any, notes: Notes) -> None:
        self._time, self._notes = time, notes
        self._cache = UsdSkel.Cache()
        self._bound: dict[Any, tuple[Any, Any]] = {}  # (skeleton, skinning) queries by the meshes' paths
        self._places: dict[Any, Matrix] = {}  # transforms of skeletons

    def gather(self, found: list[PlacedPrim]) -> None:
        """Finds the meshes bound to skeletons below the SkelRoots among the prims."""
        roots = [each for each in found if each.prim.IsA(UsdSkel.Root)]
        walk = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
        for each in roots:
            root = UsdSkel.Root(each.prim)
            self._cache.Populate(root, walk)
            for binding in self._cache.ComputeSkelBindings(root, walk):
                query = self._cache.GetSkelQuery(binding.GetSkeleton())
                for skinning in binding.GetSkinningTargets():
                    self._bound[skinning.GetPrim().GetPath()] = (query, skinning)
        if roots:
            self._places = {each.prim.GetPath(): each.places for each in found if each.prim.IsA(UsdSkel.Skeleton)}

    def shape_of(self, prim: Any) -> Shape | None:
        """Returns the deformed points and normals of a mesh in its skeleton's space; None if no skeleton deforms the mesh."""
        known = self._bound.get(prim.GetPath())
        if known is None or not known[0]:
            return None
        query, skinning = known
        mesh = UsdGeom.Mesh(prim)
        points = primvars.array(mesh.GetPointsAttr().Get(self._time), 3).astype(np.float64)
        normals = self._normals(mesh)
        if skinning.HasBlendShapes():
            points = self._blended(query, skinning, points)
        joints, weights = self._influences(skinning, len(points))
        if weights is None:
            own = None if normals is None else normals.astype(np.float32)
            return Shape(in_exact_type(points), own, own)
        given = query.ComputeSkinningTransforms(self._time)
        transforms = np.asarray(given, np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
        transforms = self._in_order(transforms, query.GetJointOrder(), skinning)
        if len(transforms) == 0 or joints.max(initial=0) >= len(transforms) or joints.min(initial=0) < 0:
            self._notes.add(
                Sentence("usd-joints-not-in-skeleton", "Meshes whose joints are missing in their skeleton are not deformed"),
                str(prim.GetPath()),
            )
            return None
        bind = matrix(skinning.GetGeomBindTransform(self._time))
        if str(skinning.GetSkinningMethod()) == "dualQuaternion":
            self._notes.add(
                Sentence("dual-quaternion-skins", "Dual-quaternion skins are deformed linearly"),
                str(prim.GetPath()),
            )
        whole = transforms @ bind
        bent = np.zeros_like(points)
        for k in range(joints.shape[1]):
            bent += weights[:, k : k + 1] * _transform_points(whole[joints[:, k]], points)
        turned = None if normals is None else self._skinned_normals(mesh, normals, whole, joints, weights)
        return Shape(in_exact_type(bent), turned, None if normals is None else normals.astype(np.float32))

    def _in_order(self, transforms: Matrix, order: Any, skinning: Any) -> Matrix:
        """Returns a skeleton's joint transforms, reordered as a mesh's `skel:joints`.

        order: the skeleton's joint names. Joints that the skeleton lacks get the identity, with a note.
        """
        own = skinning.GetJointOrder()
        if own is None or not len(own):
            return transforms
        number = {str(joint): i for i, joint in enumerate(order) if i < len(transforms)}
        joints = [str(joint) for joint in own]
        if lacking := [joint for joint in joints if joint not in number]:
            self._notes.add(
                Sentence(
                    "usd-joints-missing",
                    "Joints that are missing in the skeleton stand still ({joints})",
                    joints=first_items((each[-80:] for each in lacking), 3),
                ),
                str(skinning.GetPrim().GetPath()),
            )
        with_rest = np.concatenate([transforms, np.eye(4)[None]])
        return with_rest[[number.get(joint, -1) for joint in joints]]

    def places_of(self, prim: Any, own: Matrix) -> Matrix:
        """Returns the (N, 4, 4) transforms of a deformed mesh: its skeleton's, or `own` if only blend shapes deform it."""
        query, skinning = self._bound[prim.GetPath()]
        if not skinning.HasJointInfluences():
            return own
        return self._places.get(query.GetSkeleton().GetPrim().GetPath(), own)

    def _influences(self, skinning: Any, points: int) -> tuple[npt.NDArray[np.int64], F64 | None]:
        """Returns (V, k) joint indices and normalised weights; the weights are None if absent, of a wrong size or not finite."""
        none: tuple[npt.NDArray[np.int64], None] = np.zeros((0, 1), np.int64), None
        if not skinning.HasJointInfluences():
            return none
        found = skinning.ComputeVaryingJointInfluences(points, self._time)
        if not found:
            return none
        each = skinning.GetNumInfluencesPerComponent()
        joints, weights = np.asarray(found[0], np.int64), np.asarray(found[1], np.float64)
        if joints.size != points * each or weights.size != joints.size or not np.isfinite(weights).all():
            return none
        weights = weights.reshape(points, each)
        total = weights.sum(axis=1, keepdims=True)
        return joints.reshape(points, each), weights / np.where(total > 0, total, 1)

    def _blended(self, query: Any, skinning: Any, points: F64) -> F64:
        """Returns the points displaced by the weighted blend shapes."""
        animation = query.GetAnimQuery()
        given = animation.ComputeBlendShapeWeights(self._time) if animation else None
        if not given:
            return points
        own = skinning.GetBlendShapeOrder()
        if own is not None and len(own):
            by_name = dict(zip(map(str, animation.GetBlendShapeOrder()), given, strict=False))
            given = [float(by_name.get(str(name), 0.0)) for name in own]
        blend = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(skinning.GetPrim()))
        computed = blend.ComputeSubShapeWeights(given)
        sub_weights, blend_indices, sub_indices = computed[-3:]
        offsets = blend.ComputeSubShapePointOffsets()
        indices = blend.ComputeBlendShapePointIndices()
        if any(blend.GetBlendShape(i).GetNormalOffsetsAttr().HasAuthoredValue() for i in range(blend.GetNumBlendShapes())):
            self._notes.add(
                Sentence("usd-blend-shape-normals-ignored", "Normals are not changed by blend shapes"),
                str(skinning.GetPrim().GetPath()),
            )
        result = points.copy()
        for weight, shape, sub in zip(sub_weights, blend_indices, sub_indices, strict=True):
            if sub >= len(offsets) or shape >= len(indices):
                self._notes.add(
                    Sentence("usd-blend-shapes-damaged", "Damaged blend shapes are left out"),
                    str(skinning.GetPrim().GetPath()),
                )
                continue
            moved = np.asarray(offsets[sub], np.float64).reshape(-1, 3)
            which = np.asarray(indices[shape], np.int64)
            if len(which) == 0:
                which = np.arange(len(moved))
            if len(which) == len(moved) and (len(which) == 0 or (which.min() >= 0 and which.max() < len(points))):
                np.add.at(result, which, weight * moved)
        return result

    def _normals(self, mesh: Any) -> F64 | None:
        """Returns a mesh's normals per point or per corner, with per-face normals repeated for each corner; None if absent."""
        primvar = primvars.find_primvar(mesh.GetPrim(), "normals")
        given = mesh.GetNormalsAttr().Get(self._time) if primvar is None else primvar.ComputeFlattened(self._time)
        values = primvars.array(given, 3).astype(np.float64)
        kind = mesh.GetNormalsInterpolation() if primvar is None else primvar.GetInterpolation()
        counts = primvars.integers(mesh.GetFaceVertexCountsAttr().Get(self._time))
        if kind == "uniform" and len(values) == len(counts) and counts.min(initial=0) >= 0:
            values = np.repeat(values, counts, axis=0)
        return values if len(values) else None

    def _skinned_normals(
        self, mesh: Any, normals: F64, transform: Matrix, joints: npt.NDArray[np.int64], weights: F64
    ) -> F32 | None:
        """Returns the normals, per point or per corner, transformed by their points' joints; None if their number does not fit.

        transform: (J, 4, 4) joint transforms; joints, weights: (V, k) influences of each point.
        """
        corners = primvars.integers(mesh.GetFaceVertexIndicesAttr().Get(self._time))
        point = corners if len(normals) == len(corners) else np.arange(len(normals))
        if point.max(initial=-1) >= len(joints) or point.min(initial=0) < 0:
            return None
        x, y, z = (transform[:, :3, k] for k in range(3))
        carry = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)  # det(M) M^-T
        turned = np.zeros_like(normals)
        for k in range(joints.shape[1]):
            turned += weights[point, k : k + 1] * np.einsum("vij,vj->vi", carry[joints[point, k]], normals)
        found: F32 = turned.astype(np.float32)
        return found


def _transform_points(matrices: Matrix, points: F64) -> F64:
    found: F64 = np.einsum("vij,vj->vi", matrices[:, :3, :3], points) + matrices[:, :3, 3]
    return found
