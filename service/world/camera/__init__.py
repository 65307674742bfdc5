"""What a camera on a vehicle sees: a scene made from the road, light and weather, and a renderer in compiled code."""

from service.world.camera.labels import VEHICLE_ID, Label
from service.world.camera.poses import poses_of
from service.world.camera.render import Camera, Images
from service.world.camera.scene import Scene, build_scene
from service.world.camera.weather import Weather, weather_of

__all__ = [
    "VEHICLE_ID",
    "Camera",
    "Images",
    "Label",
    "Scene",
    "Weather",
    "build_scene",
    "poses_of",
    "weather_of",
]
