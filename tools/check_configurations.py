"""Loads the configurations for mjlab and Isaac Lab that `gaitfit export` wrote, where these packages are installed.

mjlab builds its entity of mjlab_robot.py, and the compiled model must have the joints' numbers and actuators of robot.xml.
Isaac Lab makes its actuator configuration of isaac_lab.py. Without the package a file is parsed, which is said.

Usage: python tools/check_configurations.py FOLDER
"""

import argparse
import ast
import importlib
import json
import pathlib
import sys

import mujoco
import numpy as np


def load(folder, package, module):
    """The module, or None where its package is not installed."""
    ast.parse((folder / f"{module}.py").read_text(encoding="utf-8"))
    try:
        importlib.import_module(package)
    except ImportError as missing:
        print(f"{module}.py: parsed only, for {missing}")
        return None
    return importlib.import_module(module)


def check_mjlab(folder, robot):
    from mjlab.entity import EntityArticulationInfoCfg, EntityCfg

    articulation = EntityArticulationInfoCfg(actuators=robot.ACTUATORS)
    entity = EntityCfg(spec_fn=robot.spec, articulation=articulation).build()
    found, want = entity.spec.compile(), mujoco.MjModel.from_xml_path(str(folder / "robot.xml"))
    joints = json.loads((folder / "theta.json").read_text(encoding="utf-8"))["joints"]
    assert found.nu == want.nu == len(joints)
    driven = {want.joint(want.actuator(i).trnid[0]).name: i for i in range(want.nu)}
    own = {found.joint(found.actuator(i).trnid[0]).name: i for i in range(found.nu)}
    for name, joint in joints.items():
        dof = found.joint(name).dofadr[0]
        assert found.dof_armature[dof] == joint["armature"] and found.dof_frictionloss[dof] == joint["frictionloss"], name
        a, b = own[name], driven[name]
        assert np.isclose(found.actuator_gainprm[a][0], want.actuator_gainprm[b][0]), name
        assert np.allclose(found.actuator_biasprm[a][1:3], want.actuator_biasprm[b][1:3]), name
        if joint["torque_limit"] is not None:
            assert np.allclose(found.actuator_forcerange[a], [-joint["torque_limit"], joint["torque_limit"]]), name
    lags = {(cfg.delay_min_lag, cfg.delay_max_lag) for cfg in articulation.actuators}
    assert lags == {(robot.LAG, robot.LAG)}
    print(f"mjlab_robot.py: mjlab built {found.nu} actuators with a lag of {robot.LAG} steps")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    folder = parser.parse_args().folder
    sys.path.insert(0, str(folder))
    robot = load(folder, "mjlab", "mjlab_robot")
    if robot is not None:
        check_mjlab(folder, robot)
    isaac = load(folder, "isaaclab", "isaac_lab")
    if isaac is not None:
        joints = json.loads((folder / "theta.json").read_text(encoding="utf-8"))["joints"]
        assert sorted(isaac.ACTUATORS["joints"].joint_names_expr) == sorted(joints)
        print("isaac_lab.py: Isaac Lab took its actuators")


if __name__ == "__main__":
    main()
