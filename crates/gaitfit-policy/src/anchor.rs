//! The anchor of a motion on a robot: whether the joints that lead to it are the robot's.

use crate::{AnchorJoint, InterfaceError, Reference};
use gaitfit_model::{Model, shown};

/// Min cosine of the angle between axes that count as one: 2.6°.
const ALONG: f64 = 0.999;
/// Min real part of the rotation of a link that counts as not turned: 0.5°, as the part is the cosine of half
/// the angle.
const STRAIGHT: f64 = 0.999_99;

impl Reference {
    /// Checks the anchor on a robot. `joints`: the policy's; `resolved`: their places in the model.
    ///
    /// # Errors
    /// Joints that do not follow each other from the base on, another axis, a link that is turned at angle 0, or another body than
    /// the policy's file names.
    pub(crate) fn check_anchor(
        &self,
        model: &Model,
        joints: &[String],
        resolved: &[usize],
    ) -> Result<(), InterfaceError> {
        let refuse = |what: String| Err(InterfaceError(format!("the reference motion's `anchor` {what}")));
        // Body 0 is the base, where every chain begins.
        let mut body = 0;
        let mut before: Option<usize> = None;
        let mut listed = Vec::new();
        for AnchorJoint { joint, axis } in &self.anchor {
            let place = joints.iter().position(|name| name == joint).and_then(|place| resolved.get(place));
            // Names that are not the policy's were refused when the motion was checked.
            let Some(&index) = place else { continue };
            let hinge = &model.joints[index];
            let chain = links(model, hinge.body, body);
            let follows = match before {
                // Several joints of one body act in the order of the list.
                Some(last) if hinge.body == body => last < index,
                _ => chain.is_some() && hinge.body != body,
            };
            if !follows {
                let from =
                    before.map_or(model.bodies[0].name.as_str(), |last| model.joints[last].name.as_str());
                return refuse(format!(
                    "has `{}` after `{}`, which does not carry it on robot `{}`; list each joint from the base to the anchor once, \
                     in this order",
                    shown(joint),
                    shown(from),
                    shown(&model.name)
                ));
            }
            let size = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
            // The file's axis need not have length 1; the model's has.
            let cosine = axis.iter().zip(hinge.axis).map(|(a, b)| a * b).sum::<f64>() / size;
            // The opposite direction is refused too: it would turn the sign of the angle around.
            if cosine < ALONG {
                return refuse(format!(
                    "turns `{}` about {axis:?}, and robot `{}` turns it about {:?}; write the robot's axis",
                    shown(joint),
                    shown(&model.name),
                    hinge.axis
                ));
            }
            // By size: a quaternion and its negative are the same rotation.
            if let Some(turned) =
                chain.into_iter().flatten().find(|&link| model.bodies[link].quat[0].abs() < STRAIGHT)
            {
                return refuse(format!(
                    "leads over `{}`, which is turned where its angle is 0: such anchors are not read",
                    shown(&model.bodies[turned].name)
                ));
            }
            (body, before) = (hinge.body, Some(index));
            listed.push(index);
        }
        // A body with several hinges is turned by all of them.
        let of_listed = |body: usize| listed.iter().any(|&other: &usize| model.joints[other].body == body);
        let missing =
            model.joints.iter().enumerate().find(|(index, joint)| {
                joint.kind.is_hinge() && of_listed(joint.body) && !listed.contains(index)
            });
        if let Some((_, held)) = missing.filter(|(index, _)| !resolved.contains(index)) {
            return refuse(format!(
                "leads over `{}`, which `{}` turns too, and that is no joint of the policy: such anchors are not read",
                shown(&model.bodies[held.body].name),
                shown(&held.name)
            ));
        }
        if let Some((_, missing)) = missing {
            return refuse(format!(
                "leaves out `{}`, which turns `{}` of robot `{}` too; list each joint from the base to the anchor once, in this \
                 order",
                shown(&missing.name),
                shown(&model.bodies[missing.body].name),
                shown(&model.name)
            ));
        }
        // Where the file does not name the anchor's body, the list of joints is all there is to check.
        let Some(name) = self.anchor_body.as_deref() else { return Ok(()) };
        let Some(named) = model.bodies.iter().position(|body| body.name == name) else {
            return refuse(format!(
                "is not known: the policy's file names the body `{}`, which robot `{}` does not have. Write [reference] with `file` \
                 and `anchor`: the joints from the base to it, or [] if it is the base",
                shown(name),
                shown(&model.name)
            ));
        };
        let moves = |body: usize| model.joints.iter().any(|joint| joint.body == body);
        // A body that is fixed to the last joint's body moves with it.
        if named == body || (!moves(named) && links(model, named, body).is_some()) {
            return Ok(());
        }
        // For the message: all joints from the base to the named body, as `anchor` should list them.
        let mut up: Vec<usize> =
            std::iter::successors(Some(named), |&body| model.bodies[body].parent).collect();
        up.reverse();
        let listed: Vec<String> = up
            .iter()
            .flat_map(|body| model.joints.iter().filter(move |joint| joint.body == *body))
            .map(|joint| format!("{{ joint = \"{}\", axis = {:?} }}", shown(&joint.name), joint.axis))
            .collect();
        refuse(format!(
            "is missing: the policy's file names the body `{}`, which is not the base of robot `{}`. Write [reference] with `file` \
             and anchor = [{}]",
            shown(name),
            shown(&model.name),
            listed.join(", ")
        ))
    }
}

/// The bodies from `to`, which is left out, down to `body`, if no joint but those of `body` moves between them.
fn links(model: &Model, body: usize, to: usize) -> Option<Vec<usize>> {
    let moves = |body: usize| model.joints.iter().any(|joint| joint.body == body);
    let mut chain = Vec::new();
    let mut at = body;
    while at != to {
        if at != body && moves(at) {
            return None;
        }
        chain.push(at);
        at = model.bodies[at].parent?;
    }
    Some(chain)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn an_anchor_is_held_against_the_robot() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
        let model = gaitfit_model::read(file.as_ref(), &Default::default()).unwrap();
        let joints: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
        let resolved: Vec<usize> = (0..joints.len()).collect();
        let hip = |axis: [f64; 3]| AnchorJoint { joint: "FL_hip_joint".into(), axis };
        let thigh = AnchorJoint { joint: "FL_thigh_joint".into(), axis: [0.0, 1.0, 0.0] };
        let check = |anchor: Vec<AnchorJoint>, body: Option<&str>| {
            let reference = Reference {
                rate_hz: 50.0,
                position: vec![0.0; 12],
                velocity: vec![0.0; 12],
                orientation: Vec::new(),
                anchor,
                anchor_body: body.map(str::to_owned),
            };
            reference.check_anchor(&model, &joints, &resolved).map_err(|error| error.to_string())
        };
        let along = hip([2.0, 0.0, 0.0]);
        assert_eq!(check(vec![along.clone(), thigh.clone()], Some("FL_thigh")), Ok(()));
        assert_eq!(check(vec![along.clone()], None), Ok(()));
        assert_eq!(check(Vec::new(), Some("base")), Ok(()));
        for (anchor, body, word) in [
            (vec![hip([0.0, 0.0, 1.0])], None, "write the robot's axis"),
            (vec![hip([-1.0, 0.0, 0.0])], None, "write the robot's axis"),
            (vec![thigh.clone()], None, "does not carry it"),
            (vec![thigh, along.clone()], None, "does not carry it"),
            (
                Vec::new(),
                Some("FL_thigh"),
                "anchor = [{ joint = \"FL_hip_joint\", axis = [1.0, 0.0, 0.0] }, { joint = \"FL_thigh_joint\"",
            ),
            (vec![along], Some("FL_thigh"), "names the body `FL_thigh`, which is not the base"),
            (Vec::new(), Some("torso_link"), "names the body `torso_link`, which robot"),
        ] {
            let text = check(anchor, body).unwrap_err();
            assert!(text.contains(word), "`{word}` is not in `{text}`");
        }
    }

    #[test]
    fn all_hinges_of_a_body_are_listed() {
        let inertial = "<inertial pos='0 0 0' mass='1' diaginertia='0.1 0.1 0.1'/>";
        let text = format!(
            "<mujoco><worldbody><body name='base'><freejoint/>{inertial}<body name='torso'><joint name='roll' axis='1 0 0'/>\
             <joint name='pitch' axis='0 1 0'/>{inertial}<body name='head'><joint name='yaw' axis='0 0 1'/>{inertial}</body>\
             </body></body></worldbody></mujoco>"
        );
        let model = gaitfit_model::read_mjcf_str(&text, &Default::default()).unwrap();
        let joints: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
        let check = |names: &[&str]| {
            let axis = |name: &str| model.joints[model.find_joint(name).unwrap()].axis;
            let anchor = |&name: &&str| AnchorJoint { joint: name.to_owned(), axis: axis(name) };
            let reference = Reference {
                rate_hz: 50.0,
                position: vec![0.0; 3],
                velocity: vec![0.0; 3],
                orientation: Vec::new(),
                anchor: names.iter().map(anchor).collect(),
                anchor_body: None,
            };
            reference.check_anchor(&model, &joints, &[0, 1, 2]).map_err(|error| error.to_string())
        };
        assert_eq!([check(&["roll", "pitch"]), check(&["roll", "pitch", "yaw"])], [Ok(()), Ok(())]);
        for (names, missing) in
            [(&["roll"][..], "`pitch`"), (&["pitch"], "`roll`"), (&["pitch", "yaw"], "`roll`")]
        {
            let text = check(names).unwrap_err();
            assert!(text.contains(&format!("leaves out {missing}")), "{text}");
        }
    }
}
