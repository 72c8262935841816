"""Scenes: the tables of TOML, read, checked, written back."""

from .idle import idle_keys
from .keys import Disc, Hub, MeshFile, Scene, Shaft
from .load import build_scene, dump_scene, json_schema, load_scene, scene_names
from .script import with_script_friction

__all__ = [
    "Disc",
    "Hub",
    "MeshFile",
    "Scene",
    "Shaft",
    "build_scene",
    "dump_scene",
    "idle_keys",
    "json_schema",
    "load_scene",
    "scene_names",
    "with_script_friction",
]
