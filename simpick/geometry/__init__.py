"""Geometry: rigid transforms, pinhole cameras, crops, symmetries and farthest points.

Conventions, everywhere in simpick:

- transform: ``T_a_b`` (4, 4) maps points in frame b to frame a; inner names cancel:
  ``T_world_part = T_world_camera @ T_camera_part``. Batches are ``Ts_a_b`` (n, 4, 4).
- quaternion: wxyz; reordered only in adapters that need xyzw.
- camera: OpenCV, +x right, +y down, +z forward; pixel centres at integer + 0.5, so the image spans
  [0, width] x [0, height]. MuJoCo cameras look along -z with +y up; `opencv_from_mujoco_camera` is the only function
  that flips.
- box: ``xyxy`` in pixels, in the same continuous coordinates: right and bottom edges exclusive.
- units: SI (m, kg, s, rad, N). A suffix where the unit is not obvious: ``_m``, ``_px``, ``_rad``, ``_deg``.
- part frame: origin at the centre of the mesh's axis-aligned bounding box; `Part.T_cad_part` maps to the CAD file's own
  frame.
- TCP frame: +z approaches the part; the jaw's fingers close along x; origin midway between the finger pads, for suction
  at the centre of the unloaded face.
- world frame: +z up, z = 0 the floor of the bin; the arm's base at the origin, the bin ahead of it along +x.
- randomness: an argument (`numpy.random.Generator`, `torch.Generator`); never a global seed or draw.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
