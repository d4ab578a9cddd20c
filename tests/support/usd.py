"""USDZ files as OpenUSD reads them: an independent reader, and its validators."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import trimesh
from pxr import Usd, UsdGeom, UsdShade, UsdValidation


def read(data: bytes) -> trimesh.Trimesh:
    """Read the one mesh of a USDZ file, with its normals; if it has colors, they are the attribute "color"."""
    with _stage(data) as stage:
        prim = _mesh(stage)
        mesh = UsdGeom.Mesh(prim)
        assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
        color = UsdGeom.PrimvarsAPI(prim).GetPrimvar("displayColor")
        is_colored = color.GetInterpolation() == "vertex"
        assert is_colored or len(color.Get()) == 1
        return trimesh.Trimesh(
            np.array(mesh.GetPointsAttr().Get()),
            np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3),
            vertex_normals=np.array(mesh.GetNormalsAttr().Get()),
            vertex_attributes={"color": np.array(color.Get())} if is_colored else {},
            process=False,
        )


def check_valid(data: bytes) -> str:
    """Check a USDZ file by every validator of OpenUSD, and what Quick Look needs besides; return its scene as text."""
    with _stage(data) as stage:
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
        assert len(validators) >= 20
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
        assert [error.GetMessage() for error in errors] == []
        assert stage.GetRootLayer().GetFileFormat().formatId == "usdz"
        assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Y", 1)
        material, _ = UsdShade.MaterialBindingAPI(_mesh(stage)).ComputeBoundMaterial()
        assert UsdShade.Shader(material.ComputeSurfaceSource()[0]).GetShaderId() == "UsdPreviewSurface"
        text: str = stage.GetRootLayer().ExportToString()
        return text


def _mesh(stage: Usd.Stage) -> Usd.Prim:
    (prim,) = (each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh))
    return prim


@contextmanager
def _stage(data: bytes) -> Iterator[Usd.Stage]:
    """Open a file under a path of its own: OpenUSD remembers files by their paths."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "object.usdz"
        file.write_bytes(data)
        yield Usd.Stage.Open(str(file))
