"""A scene whose friction a script gives as an object: its table [friction] then names that object."""

from __future__ import annotations

import msgspec

from ..errors import SceneError
from ..friction import ScriptFriction
from .keys import FrictionKeys, Scene


def with_script_friction(scene: Scene, friction: ScriptFriction) -> Scene:
    """The scene with the object's name and options as its [friction], so that no file tells of another friction.

    The options of a scene that names the object already go to the callable that makes it; those of another provider
    are left out with it.

    Raises:
        SceneError: the scene gives options to an object that is made already.
    """
    own = scene.friction.provider == friction.name
    if friction.makes and own:
        return scene
    others = [key for key, value in scene.friction.options.items() if friction.options.get(key, ...) != value]
    if own and others:
        raise SceneError(
            f"friction.options.{others[0]}: cannot change, for {friction.name} is an object that is made already; "
            f"give what makes it, for example its class"
        )
    keys = FrictionKeys(provider=friction.name, options=friction.options)
    return msgspec.structs.replace(scene, friction=keys)
