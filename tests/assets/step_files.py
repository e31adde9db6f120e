"""The text of a STEP file (ISO 10303-21) of a box, so that reading STEP is tested without a file from elsewhere."""

from __future__ import annotations

from itertools import product

import numpy as np

_HEADER = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
#1=APPLICATION_CONTEXT('automotive design');
#2=APPLICATION_PROTOCOL_DEFINITION('','automotive_design',2000,#1);
#3=PRODUCT_CONTEXT('',#1,'mechanical');
#4=PRODUCT('box','box','',(#3));
#5=PRODUCT_DEFINITION_FORMATION('','',#4);
#6=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#7=PRODUCT_DEFINITION('','',#5,#6);
#8=PRODUCT_DEFINITION_SHAPE('','',#7);
#9=UNIT;
#10=(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.));
#11=(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT());
#12=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),#9,'','');
#13=(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#12))
 GLOBAL_UNIT_ASSIGNED_CONTEXT((#9,#10,#11)) REPRESENTATION_CONTEXT('',''));
"""


def step_box(size: tuple[float, float, float], unit: str) -> str:
    """Return a box of this size, from the origin, in this unit (an entity of STEP), as one faceted solid."""
    lines: list[str] = []

    def add(entity: str) -> str:
        lines.append(f"#{100 + len(lines)}={entity};")
        return f"#{99 + len(lines)}"

    def numbers(vector: np.ndarray) -> str:
        return ",".join(f"{x:.9f}" for x in vector)

    corners = {key: add(f"CARTESIAN_POINT('',({numbers(np.array(key) * size)}))") for key in product((0, 1), repeat=3)}
    faces = []
    for axis, side in product(range(3), (0, 1)):
        ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
        around = [tuple(np.roll([side, u, v], axis).tolist()) for u, v in (ring if side else ring[::-1])]
        normal = np.eye(3)[axis] * (1 if side else -1)
        along = np.subtract(around[1], around[0]).astype(float)
        directions = [add(f"DIRECTION('',({numbers(vector)}))") for vector in (normal, along)]
        placement = add(f"AXIS2_PLACEMENT_3D('',{corners[around[0]]},{','.join(directions)})")
        plane = add(f"PLANE('',{placement})")
        loop = add(f"POLY_LOOP('',({','.join(corners[key] for key in around)}))")
        bound = add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        faces.append(add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = add(f"FACETED_BREP('',{shell})")
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',({solid}),#13)")
    add(f"SHAPE_DEFINITION_REPRESENTATION(#8,{shape})")
    return _HEADER.replace("#9=UNIT;", f"#9={unit};") + "\n".join(lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"
