#!/usr/bin/env python3
"""Writes assets/go2.urdf from assets/go2.xml: the same robot as far as URDF can say it.

Usage: python tools/make_go2_urdf.py
Needs the packages of tools/requirements.txt. Inertias are full tensors with 17 digits, so that both files
compile to the same numbers.
"""

import pathlib

import mujoco
import numpy as np

ASSETS = pathlib.Path(__file__).resolve().parent.parent / "assets"
SPEED = {"hip": 30.1, "thigh": 30.1, "calf": 15.70}
GEOM = mujoco.mjtGeom


def rpy(quat):
    """Roll, pitch, yaw of a wxyz quaternion (fixed axes)."""
    w, x, y, z = quat / np.linalg.norm(quat)
    return (
        np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
        np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def text(values):
    """Numbers that read back to the same bits."""
    return " ".join("0" if v == 0 else repr(float(v)) for v in values)


def inertial(model, body):
    """<inertial> with the tensor in the link's axes."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    i = turn @ np.diag(model.body_inertia[body]) @ turn.T
    parts = dict(ixx=i[0, 0], ixy=i[0, 1], ixz=i[0, 2], iyy=i[1, 1], iyz=i[1, 2], izz=i[2, 2])
    return [
        "    <inertial>",
        f'      <origin xyz="{text(model.body_ipos[body])}"/>',
        f'      <mass value="{text([model.body_mass[body]])}"/>',
        "      <inertia " + " ".join(f'{k}="{text([v])}"' for k, v in parts.items()) + "/>",
        "    </inertial>",
    ]


def collision(model, geom):
    """<collision> of a primitive."""
    size = model.geom_size[geom]
    shape = {
        GEOM.mjGEOM_SPHERE: f'<sphere radius="{text(size[:1])}"/>',
        GEOM.mjGEOM_CYLINDER: f'<cylinder radius="{text(size[:1])}" length="{text(2 * size[1:2])}"/>',
        GEOM.mjGEOM_BOX: f'<box size="{text(2 * size)}"/>',
    }[GEOM(model.geom_type[geom])]
    origin = f'xyz="{text(model.geom_pos[geom])}" rpy="{text(rpy(model.geom_quat[geom]))}"'
    return [
        f'    <collision name="{model.geom(geom).name}">',
        f"      <origin {origin}/>",
        f"      <geometry>{shape}</geometry>",
        "    </collision>",
    ]


def main():
    """Links and joints in MuJoCo's order."""
    model = mujoco.MjModel.from_xml_path(str(ASSETS / "go2.xml"))
    lines = [
        '<?xml version="1.0"?>',
        "<!-- Unitree Go2, written by tools/make_go2_urdf.py from go2.xml, which names its sources. -->",
        '<robot name="go2">',
    ]
    for body in range(1, model.nbody):
        lines += [f'  <link name="{model.body(body).name}">', *inertial(model, body)]
        for geom in np.flatnonzero(model.geom_bodyid == body):
            lines += collision(model, geom)
        lines.append("  </link>")
    for joint in range(1, model.njnt):
        name, body = model.joint(joint).name, model.jnt_bodyid[joint]
        low, high = model.jnt_range[joint]
        effort = model.actuator_ctrlrange[joint - 1, 1]
        lines += [
            f'  <joint name="{name}" type="revolute">',
            f'    <parent link="{model.body(model.body_parentid[body]).name}"/>',
            f'    <child link="{model.body(body).name}"/>',
            f'    <origin xyz="{text(model.body_pos[body])}"/>',
            f'    <axis xyz="{text(model.jnt_axis[joint])}"/>',
            f'    <limit lower="{low}" upper="{high}" effort="{effort}" velocity="{SPEED[name.split("_")[1]]}"/>',
            "  </joint>",
        ]
    lines.append("</robot>")
    (ASSETS / "go2.urdf").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
