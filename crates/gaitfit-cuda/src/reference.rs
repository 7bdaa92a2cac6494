//! The motion that a policy follows, as kernels' text and tables.

use gaitfit_policy::Reference;
use gaitfit_policy::observation::Layout;
use gaitfit_policy::walker::Walker;

use crate::runtime::Program;
use crate::words::{Words, braces, double};

/// Arrays of a motion that are filled when a program is loaded, by name.
#[derive(Default)]
pub(crate) struct ReferenceTables(Vec<(&'static str, Vec<f32>)>);

impl ReferenceTables {
    /// The program with these arrays.
    pub fn fill(self, program: Program) -> Program {
        self.0.into_iter().fold(program, |program, (name, numbers)| program.table(name, numbers))
    }
}

/// A joint between the base and the motion's anchor.
const ANCHOR: &str =
    "// A joint between the base and the motion's anchor: its place among the policy's, and its axis.
struct Anchor {
    int joint;
    double axis[3];
};
";

impl Words {
    /// The motion that the policy follows, for rows of an actor's layout and, where there is one, a critic's.
    pub fn reference(&mut self, walker: &Walker, actor: &Layout, critic: Option<&Layout>) -> ReferenceTables {
        let follows = actor.follows() || critic.is_some_and(Layout::follows);
        let reference = walker.interface.reference.as_ref().filter(|_| follows);
        self.define("FOLLOWS", u32::from(reference.is_some()));
        let Some(reference) = reference else { return ReferenceTables::default() };
        let joints = &walker.interface.joints;
        let anchor = reference.anchor_axes(joints).into_iter().map(|(joint, axis)| {
            let axis = braces(axis, double);
            format!("{{{joint}, {axis}}}")
        });
        let anchor: Vec<String> = anchor.collect();
        for (name, value) in [
            // Only the actor's observation turns the motion and has a distance from it.
            ("ACTOR_FOLLOWS", usize::from(actor.follows())),
            ("REFERENCE_SAMPLES", reference.samples(joints.len())),
            ("REFERENCE_TURNS", usize::from(!reference.orientation.is_empty())),
            ("ANCHORS", anchor.len()),
        ] {
            self.define(name, value);
        }
        self.define("REFERENCE_RATE", double(reference.rate_hz));
        self.define("SAME_SAMPLE", double(Reference::SAME_SAMPLE));
        self.text.push_str(ANCHOR);
        self.table("Anchor", "ANCHOR", anchor);
        let Reference { position, velocity, orientation, .. } = reference;
        let tables = [
            ("REFERENCE_POSITION", position),
            ("REFERENCE_VELOCITY", velocity),
            ("REFERENCE_ORIENTATIONS", orientation),
        ];
        let tables = tables.into_iter().filter(|(_, numbers)| !numbers.is_empty());
        let tables: Vec<_> = tables.map(|(name, numbers)| (name, numbers.clone())).collect();
        for (name, numbers) in &tables {
            self.text.push_str(&format!("__device__ float {name}[{}];\n", numbers.len()));
        }
        ReferenceTables(tables)
    }
}
