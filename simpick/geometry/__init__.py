"""Geometry: rigid transforms, pinhole cameras, crops, symmetries and mesh sampling.

Conventions, everywhere in simpick:

=============  ==================================================================================================
transform      ``T_a_b`` (4, 4) maps points in frame b to frame a; inner names cancel:
               ``T_world_part = T_world_camera @ T_camera_part``. Batches are ``Ts_a_b`` (n, 4, 4).
quaternion     wxyz; reordered only in adapters that need xyzw.
camera         OpenCV: +x right, +y down, +z forward; pixel centres at integer + 0.5, so the image spans
               [0, width] x [0, height]. MuJoCo cameras look along -z with +y up; `opencv_from_mujoco_camera`
               is the one function that flips.
box            ``xyxy`` in pixels, in the same continuous coordinates: right and bottom edges exclusive.
units          SI: m, kg, s, rad, N. A suffix where a name could be doubted: ``_m``, ``_px``, ``_rad``, ``_deg``.
part frame     origin at the centre of the mesh's axis-aligned bounding box; `Part.T_cad_part` leads back to the
               CAD file's own frame.
TCP frame      +z approaches the part; the jaw's fingers close along x; origin midway between the finger pads,
               for suction at the centre of the unloaded face.
world frame    +z up, z = 0 the floor of the bin; the arm's base at the origin, the bin ahead of it along +x.
randomness     an argument (`numpy.random.Generator`, `torch.Generator`); never a global seed or draw.
=============  ==================================================================================================
"""

from simpick.geometry.crops import Crop as Crop
from simpick.geometry.crops import CropBatch as CropBatch
from simpick.geometry.crops import VirtualCameras as VirtualCameras
from simpick.geometry.crops import aim_virtual_cameras as aim_virtual_cameras
from simpick.geometry.crops import crop_image as crop_image
from simpick.geometry.crops import crop_images as crop_images
from simpick.geometry.image_boxes import box_of_mask as box_of_mask
from simpick.geometry.image_boxes import turned_boxes as turned_boxes
from simpick.geometry.mesh_sampling import farthest_points as farthest_points
from simpick.geometry.mesh_sampling import sample_surface as sample_surface
from simpick.geometry.pinhole import Pinhole as Pinhole
from simpick.geometry.pinhole import opencv_from_mujoco_camera as opencv_from_mujoco_camera
from simpick.geometry.symmetry import ContinuousSymmetry as ContinuousSymmetry
from simpick.geometry.symmetry import SymmetryGroup as SymmetryGroup
from simpick.geometry.transforms import invert as invert
from simpick.geometry.transforms import look_at as look_at
from simpick.geometry.transforms import matrix_from_quaternion as matrix_from_quaternion
from simpick.geometry.transforms import quaternion_from_matrix as quaternion_from_matrix
from simpick.geometry.transforms import random_rotation as random_rotation
from simpick.geometry.transforms import rotation_angle as rotation_angle
from simpick.geometry.transforms import rotation_from_6d as rotation_from_6d
from simpick.geometry.transforms import rotation_to_6d as rotation_to_6d
from simpick.geometry.transforms import se3_exp as se3_exp
from simpick.geometry.transforms import se3_log as se3_log
from simpick.geometry.transforms import skew as skew
from simpick.geometry.transforms import so3_exp as so3_exp
from simpick.geometry.transforms import so3_log as so3_log
from simpick.geometry.transforms import transform as transform
from simpick.geometry.transforms import transform_points as transform_points
