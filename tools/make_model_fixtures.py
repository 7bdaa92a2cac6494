#!/usr/bin/env python3
"""Writes what MuJoCo 4.0.0 compiles from the test robots, for the tests of crates/gaitfit-model.

Usage: python tools/make_model_fixtures.py
Needs the packages of tools/requirements.txt. Output: crates/gaitfit-model/tests/fixtures/*.json.
"""

import json
import pathlib

import mujoco
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
TESTS = ROOT / "crates" / "gaitfit-model" / "tests"
ROBOTS = [ROOT / "assets" / "go2.xml", *sorted((TESTS / "robots").glob("*.xml"))]
PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


def names(model, kind, count):
    """Names of all objects of a kind, empty where the file gives none."""
    return [mujoco.mj_id2name(model, kind, i) or "" for i in range(count)]


def plane_contacts(model):
    """One contact of every geom-plane pair in MuJoCo's order: all planes are lifted above the robot."""
    lifted = mujoco.MjModel.__copy__(model)
    # The bounding-volume trees would still have the planes where they were.
    lifted.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    data = mujoco.MjData(lifted)
    mujoco.mj_kinematics(lifted, data)
    for geom in np.flatnonzero(lifted.geom_type == PLANE):
        normal = data.geom_xmat[geom].reshape(3, 3)[:, 2]
        body = data.xmat[lifted.geom_bodyid[geom]].reshape(3, 3)
        lifted.geom_pos[geom] += body.T @ (20.0 * normal)
        lifted.geom_sameframe[geom] = 0  # a plane at its body's origin is one no longer
    mujoco.mj_forward(lifted, data)
    seen, rows = set(), []
    for contact in data.contact:
        pair = (int(contact.geom[0]), int(contact.geom[1]))
        if PLANE not in (lifted.geom_type[pair[0]], lifted.geom_type[pair[1]]) or pair in seen:
            continue
        seen.add(pair)
        rows.append(
            dict(
                geom=pair,
                dim=int(contact.dim),
                friction=contact.friction.tolist(),
                solref=contact.solref.tolist(),
                solreffriction=contact.solreffriction.tolist(),
                solimp=contact.solimp.tolist(),
                includemargin=float(contact.includemargin),
            )
        )
    return rows


def dump(model):
    """The compiled numbers, hinges only, in MuJoCo's order."""
    hinges = np.flatnonzero(model.jnt_type == HINGE)
    dofs = model.jnt_dofadr[hinges]
    obj = mujoco.mjtObj

    def rows(array, index=slice(None)):
        return np.asarray(array)[index].tolist()

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    planes = np.flatnonzero(model.geom_type == PLANE)
    return dict(
        mujoco=mujoco.__version__,
        nq=model.nq,
        nv=model.nv,
        nu=model.nu,
        option=dict(
            timestep=model.opt.timestep,
            gravity=rows(model.opt.gravity),
            cone=int(model.opt.cone),
            impratio=model.opt.impratio,
            integrator=int(model.opt.integrator),
            iterations=model.opt.iterations,
            ls_iterations=model.opt.ls_iterations,
            disableflags=int(model.opt.disableflags),
        ),
        body=dict(
            name=names(model, obj.mjOBJ_BODY, model.nbody),
            parent=rows(model.body_parentid),
            pos=rows(model.body_pos),
            quat=rows(model.body_quat),
            mass=rows(model.body_mass),
            ipos=rows(model.body_ipos),
            iquat=rows(model.body_iquat),
            inertia=rows(model.body_inertia),
        ),
        joint=dict(
            name=[mujoco.mj_id2name(model, obj.mjOBJ_JOINT, j) or "" for j in hinges],
            body=rows(model.jnt_bodyid, hinges),
            pos=rows(model.jnt_pos, hinges),
            axis=rows(model.jnt_axis, hinges),
            reference=rows(model.qpos0, model.jnt_qposadr[hinges]),
            springref=rows(model.qpos_spring, model.jnt_qposadr[hinges]),
            limited=rows(model.jnt_limited, hinges),
            range=rows(model.jnt_range, hinges),
            margin=rows(model.jnt_margin, hinges),
            solref=rows(model.jnt_solref, hinges),
            solimp=rows(model.jnt_solimp, hinges),
            stiffness=rows(model.jnt_stiffness, hinges),
            actfrclimited=rows(model.jnt_actfrclimited, hinges),
            actfrcrange=rows(model.jnt_actfrcrange, hinges),
            armature=rows(model.dof_armature, dofs),
            damping=rows(model.dof_damping, dofs),
            frictionloss=rows(model.dof_frictionloss, dofs),
            dof_solref=rows(model.dof_solref, dofs),
            dof_solimp=rows(model.dof_solimp, dofs),
        ),
        geom=dict(
            name=names(model, obj.mjOBJ_GEOM, model.ngeom),
            type=rows(model.geom_type),
            body=rows(model.geom_bodyid),
            size=rows(model.geom_size),
            pos=rows(model.geom_pos),
            quat=rows(model.geom_quat),
            contype=rows(model.geom_contype),
            conaffinity=rows(model.geom_conaffinity),
        ),
        plane=dict(
            geom=rows(planes),
            pos=rows(data.geom_xpos, planes),
            mat=rows(data.geom_xmat, planes),
        ),
        contact=plane_contacts(model),
        actuator=dict(
            name=names(model, obj.mjOBJ_ACTUATOR, model.nu),
            joint=[mujoco.mj_id2name(model, obj.mjOBJ_JOINT, j) or "" for j in model.actuator_trnid[:, 0]],
            gear=rows(model.actuator_gear[:, 0]),
            ctrllimited=rows(model.actuator_ctrllimited),
            ctrlrange=rows(model.actuator_ctrlrange),
            forcelimited=rows(model.actuator_forcelimited),
            forcerange=rows(model.actuator_forcerange),
            gain=rows(model.actuator_gainprm[:, 0]),
            bias=rows(model.actuator_biasprm[:, :3]),
            biastype=rows(model.actuator_biastype),
        ),
        key=dict(
            name=names(model, obj.mjOBJ_KEY, model.nkey),
            qpos=rows(model.key_qpos),
            qvel=rows(model.key_qvel),
            ctrl=rows(model.key_ctrl),
        ),
        site=dict(
            name=names(model, obj.mjOBJ_SITE, model.nsite),
            body=rows(model.site_bodyid),
            pos=rows(model.site_pos),
            quat=rows(model.site_quat),
        ),
    )


def main():
    """One JSON file a robot."""
    mujoco.set_mju_user_warning(lambda message: print("MuJoCo:", message))  # and no log file
    for path in ROBOTS:
        model = mujoco.MjModel.from_xml_path(str(path))
        out = TESTS / "fixtures" / f"{path.stem}.json"
        out.write_text(json.dumps(dump(model)) + "\n")
        print(out.relative_to(ROOT), out.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
