"""Use a CAD file: import it, see what was decided, and fill a bin with it."""

from pathlib import Path

import cv2
import trimesh

from simpick import BinPickEnv
from simpick.assets import import_cad


def main(folder: Path = Path("logs/cad"), count: int = 6) -> Path:
    """Write an STL file as a CAD program would, in millimetres, and return a picture of a bin of such parts."""
    folder.mkdir(parents=True, exist_ok=True)
    plate = trimesh.creation.box(bounds=[[0, 0, 0], [60, 30, 6]])
    wall = trimesh.creation.box(bounds=[[0, 0, 0], [6, 30, 40]])
    bracket = trimesh.boolean.union([plate, wall])
    file = folder / "bracket.stl"
    bracket.export(file)

    imported = import_cad(file)
    for note in imported.notes:  # Unit, repairs, symmetry.
        print(note)
    part = imported.part
    print(f"{part.name}: {1000 * part.diameter_m:.0f} mm diameter, {1000 * part.mass_kg:.0f} g")

    env = BinPickEnv(parts=[str(file)], count=count)  # Wherever a part is named, a mesh file will do.
    observation, _ = env.reset(seed=0)
    picture = folder / "bin.png"
    cv2.imwrite(str(picture), cv2.cvtColor(observation["rgb"], cv2.COLOR_RGB2BGR))
    print(f"written: {picture}")
    env.close()
    return picture


if __name__ == "__main__":
    main()
