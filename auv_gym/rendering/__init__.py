"""Pictures of a run: a scene in, an RGB array or a window out. Needs the extra `render`."""

from auv_gym.extra import needs

with needs("Rendering needs matplotlib", "render"):
    import matplotlib  # noqa: F401

from auv_gym.rendering.camera import Camera
from auv_gym.rendering.dive import Dive
from auv_gym.rendering.renderer import Renderer, draw, film_strip
from auv_gym.rendering.scene import Scene, Target
from auv_gym.rendering.window import Window

__all__ = ["Camera", "Dive", "Renderer", "Scene", "Target", "Window", "draw", "film_strip"]
