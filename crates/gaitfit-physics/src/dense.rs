//! Dense quantities in MuJoCo's coordinates, for comparisons and inspection (`f64`, allocates).
//!
//! Velocities are MuJoCo's: for a floating base linear velocity in world axes, angular velocity in body axes,
//! then one a joint.

use crate::self_contact::SelfContactPairWork;
use crate::smooth::{displacement, inertial, joint_motion, joint_pose, root_motion, smooth};
use crate::spatial::{Rigid, V6, add6, dot6, zero6};
use crate::state::{Motion, State, Work};
use crate::tree::Tree;
use crate::vec3::*;
use crate::{Drive, Params};

/// What a constraint row belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowKind {
    /// A coupling of joints (index of the coupling in `Tree`).
    Coupling(usize),
    /// Dry friction of the free joint (degree of freedom: along the world's axes, then about the base's own).
    Free(usize),
    /// Dry friction of a joint (index of the joint).
    Friction(usize),
    /// Limit of a joint (index of the joint).
    Limit(usize),
    /// Contact of a geom–plane pair (index in `Model::pairs`, point of the pair).
    Contact(usize, usize),
    /// Self-contact (index in `Model::self_pairs`, point of the pair).
    SelfContact(usize, usize),
}

/// One row of MuJoCo's constraint: cost s(J a − aref) with stiffness D.
#[derive(Clone, Debug)]
pub struct Row {
    /// What it belongs to.
    pub kind: RowKind,
    /// Jacobian, `nv` long.
    pub jacobian: Vec<f64>,
    /// Reference acceleration.
    pub aref: f64,
    /// Stiffness D = 1/R.
    pub d: f64,
}

/// One link as a plain walk over the tree sees it.
pub(crate) struct Body {
    pub motion: Motion<f64>,
    /// Motion subspace of its joint (zero for the root).
    pub axis: V6<f64>,
    pub rigid: Rigid<f64>,
    /// Inertial wrench at zero `qacc`.
    pub wrench: V6<f64>,
}

/// Every link of a state at zero acceleration.
pub(crate) fn bodies(tree: &Tree<f64>, params: &Params<f64>, state: &State<f64>) -> Vec<Body> {
    let state = at_zero_acceleration(state);
    let root = root_motion(tree, &state);
    let (rigid, wrench) = inertial(&params.links[0], &root);
    let mut all = vec![Body { motion: root, axis: zero6(), rigid, wrench }];
    for i in 1..tree.links.len() {
        let link = &tree.links[i];
        let parent: &Motion<f64> = &all[link.parent].motion;
        let by = displacement::<f64>(link, state.qpos[i - 1]);
        let (rotation, position, axis) = joint_pose(link, by, &parent.rotation, parent.position);
        let motion = joint_motion(axis, state.qvel[i - 1], 0.0, rotation, position, parent);
        let (rigid, wrench) = inertial(&params.links[i], &motion);
        all.push(Body { motion, axis, rigid, wrench });
    }
    all
}

/// Motion subspaces in MuJoCo's order, each with the link it moves.
pub(crate) fn subspaces(tree: &Tree<f64>, bodies: &[Body]) -> Vec<(usize, V6<f64>)> {
    let mut all = Vec::with_capacity(tree.nv());
    if tree.floating {
        // Translation along the world's axes, then turns about the base's own: its axes are the columns of
        // its rotation.
        let r = bodies[0].motion.rotation;
        for k in 0..3 {
            let mut e = zero3();
            e[k] = 1.0;
            all.push((0, [zero3(), e]));
        }
        for k in 0..3 {
            all.push((0, [[r[0][k], r[1][k], r[2][k]], zero3()]));
        }
    }
    for (i, body) in bodies.iter().enumerate().skip(1) {
        all.push((i, body.axis));
    }
    all
}

/// Whether link `ancestor` carries link `link`.
pub(crate) fn carries(tree: &Tree<f64>, ancestor: usize, mut link: usize) -> bool {
    // A parent has a smaller number than its children, so the walk ends at the ancestor or passes below it.
    while link > ancestor {
        link = tree.links[link].parent;
    }
    link == ancestor
}

fn drives(tree: &Tree<f64>) -> Vec<Drive<f64>> {
    vec![Drive::<f64>::zero(); tree.joints()]
}

fn at_zero_acceleration(state: &State<f64>) -> State<f64> {
    let mut state = state.clone();
    state.base_acceleration = zero6();
    state.qacc.fill(0.0);
    state
}

/// Mass matrix with armature, `nv × nv`, row-major (composite rigid bodies, Featherstone 2008, table 6.2).
pub fn mass_matrix(tree: &Tree<f64>, params: &Params<f64>, state: &State<f64>) -> Vec<f64> {
    let bodies = bodies(tree, params, state);
    let mut composite: Vec<Rigid<f64>> = bodies.iter().map(|body| body.rigid).collect();
    // Children come after their parents, so this order completes each composite before its parent takes it.
    for i in (1..composite.len()).rev() {
        let parent = tree.links[i].parent;
        composite[parent] = composite[parent].add(&composite[i]);
    }
    let axes = subspaces(tree, &bodies);
    let n = axes.len();
    let mut m = vec![0.0; n * n];
    for (b, (link_b, axis_b)) in axes.iter().enumerate() {
        // Force that accelerates all that joint b carries by one unit along its axis.
        let force = composite[*link_b].mul(*axis_b);
        for (a, (link_a, axis_a)) in axes.iter().enumerate().take(b + 1) {
            // Joints of different branches have no inertia in common.
            if carries(tree, *link_a, *link_b) {
                m[a * n + b] = dot6(*axis_a, force);
                m[b * n + a] = m[a * n + b];
            }
        }
    }
    if let Some(free) = &tree.free {
        for dof in 0..6 {
            m[dof * (n + 1)] += free.armature;
        }
    }
    let first = n - tree.joints();
    for (j, joint) in params.joints.iter().enumerate() {
        m[(first + j) * (n + 1)] += joint.armature;
    }
    m
}

/// Coriolis, centrifugal and gravity forces, `nv` long (MuJoCo's `qfrc_bias`).
pub fn bias(tree: &Tree<f64>, params: &Params<f64>, state: &State<f64>) -> Vec<f64> {
    let bodies = bodies(tree, params, state);
    let mut wrenches: Vec<V6<f64>> = bodies.iter().map(|body| body.wrench).collect();
    // From the outermost links inward, as for the mass matrix.
    for i in (1..wrenches.len()).rev() {
        let parent = tree.links[i].parent;
        wrenches[parent] = add6(wrenches[parent], wrenches[i]);
    }
    subspaces(tree, &bodies).iter().map(|(link, axis)| dot6(*axis, wrenches[*link])).collect()
}

/// All constraint rows of a state: friction loss, limits, contacts in the order of `Model::pairs`, contacts between own
/// parts. Contacts have MuJoCo's tangents, also where the step takes others with the same cone.
///
/// As in MuJoCo there are no rows without dry friction, and those of a free joint begin with translation, while the
/// step's vectors begin with rotation. The tree has its contact pairs by link, so they are sorted here.
pub fn constraint_rows(
    tree: &Tree<f64>,
    params: &Params<f64>,
    state: &State<f64>,
    work: &mut Work<f64>,
) -> Vec<Row> {
    let mut turned = tree.clone();
    // Aligned pairs have tangents along the world's axes. All others have MuJoCo's.
    for pair in &mut turned.pairs {
        pair.aligned = false;
    }
    let tree = &turned;
    let state = at_zero_acceleration(state);
    smooth(tree, params, &state, &drives(tree), work);
    let axes = subspaces(tree, &bodies(tree, params, &state));
    let n = axes.len();
    let first = n - tree.joints();
    // The floating base has the first columns, then come the joints.
    let unit = |j: usize, sign: f64| {
        let mut row = vec![0.0; n];
        row[first + j] = sign;
        row
    };
    let mut rows = Vec::new();
    for (index, (coupling, each)) in tree.couplings.iter().zip(&work.couplings).enumerate() {
        let mut jacobian = unit(coupling.follower, 1.0);
        if let Some(leader) = coupling.leader {
            jacobian[first + leader] = -each.slope;
        }
        rows.push(Row { kind: RowKind::Coupling(index), jacobian, aref: -each.bias, d: each.d });
    }
    let rubbing = tree.free.iter().filter(|free| free.frictionloss > 0.0);
    for each in rubbing.flat_map(|_| &work.free) {
        for dof in 0..6 {
            let mut jacobian = vec![0.0; n];
            jacobian[dof] = 1.0;
            // Rows begin with translation and the work begins with rotation, so the two parts change places.
            let (part, axis) = (1 - dof / 3, dof % 3);
            let d = each.friction_d[part];
            rows.push(Row {
                kind: RowKind::Free(dof),
                jacobian,
                // The bias of friction rows is minus D times aref; that of limits is minus aref.
                aref: -each.friction_bias[part][axis] / d,
                d,
            });
        }
    }
    for (j, joint) in work.joints.iter().enumerate() {
        if params.joints[j].frictionloss > 0.0 {
            rows.push(Row {
                kind: RowKind::Friction(j),
                jacobian: unit(j, 1.0),
                aref: -joint.friction_bias / joint.friction_d,
                d: joint.friction_d,
            });
        }
    }
    for (j, joint) in work.joints.iter().enumerate() {
        if work.limited[j] && joint.limit_d > 0.0 {
            rows.push(Row {
                kind: RowKind::Limit(j),
                jacobian: unit(j, joint.limit_sign),
                aref: -joint.limit_bias,
                d: joint.limit_d,
            });
        }
    }
    let mut order: Vec<usize> = (0..tree.pairs.len()).collect();
    order.sort_by_key(|&index| tree.pairs[index].model_pair);
    for index in order {
        let pair = &tree.pairs[index];
        if !work.pairs[index].active {
            continue;
        }
        let Some(link) = tree.links.iter().position(|link| link.pairs.contains(&index)) else { continue };
        for (number, point) in work.points[pair.points.clone()].iter().enumerate() {
            if point.d > 0.0 {
                let kind = RowKind::Contact(pair.model_pair, number);
                contact_rows(tree, index, kind, link, point, &axes, work, &mut rows);
            }
        }
    }
    for (index, pair) in tree.self_contact.pairs.iter().enumerate() {
        let SelfContactPairWork { active, friction: mu } = &work.self_contact.pairs[index];
        for number in (0..pair.points.len()).filter(|_| *active) {
            let point = &work.self_contact.points[pair.points.start + number];
            if point.d > 0.0 {
                let joints = &tree.self_contact.joints[pair.joints.clone()];
                let start = pair.rows + number * pair.dims * joints.len();
                // The base moves both parts alike, so its columns stay zero.
                let mut jacobian = vec![vec![0.0; n]; pair.dims];
                for (k, row) in jacobian.iter_mut().enumerate() {
                    for (place, joint) in joints.iter().enumerate() {
                        row[first + joint.joint] = work.self_contact.rows[start + k * joints.len() + place];
                    }
                }
                let one =
                    Contact { condim: pair.condim, mu, d: point.d, jacobian, residual: &point.residual };
                one.rows(tree, RowKind::SelfContact(index, number), &mut rows);
            }
        }
    }
    rows
}

/// One contact point, with the rows of its components.
struct Contact<'a> {
    condim: usize,
    mu: &'a [f64; 5],
    d: f64,
    jacobian: Vec<Vec<f64>>,
    /// `−aref`.
    residual: &'a [f64],
}

fn contact_rows(
    tree: &Tree<f64>,
    index: usize,
    kind: RowKind,
    link: usize,
    point: &crate::state::Point<f64>,
    axes: &[(usize, V6<f64>)],
    work: &Work<f64>,
    rows: &mut Vec<Row>,
) {
    let pair = &tree.pairs[index];
    let mu = work.pairs[index].friction;
    let n = axes.len();
    let mut jacobian = vec![vec![0.0; n]; 6];
    for (column, (moved, axis)) in axes.iter().enumerate() {
        if carries(tree, *moved, link) {
            let linear = crate::contact::components(pair, &point.frame, cross_add(axis[0], point.x, axis[1]));
            let angular = crate::contact::components(pair, &point.frame, axis[0]);
            for k in 0..3 {
                jacobian[k][column] = linear[k];
                jacobian[3 + k][column] = angular[k];
            }
        }
    }
    let residual = [point.residual[0], point.residual[1]].concat();
    Contact { condim: pair.condim, mu: &mu, d: point.d, jacobian, residual: &residual }
        .rows(tree, kind, rows);
}

impl Contact<'_> {
    /// MuJoCo's rows of the contact.
    fn rows(&self, tree: &Tree<f64>, kind: RowKind, rows: &mut Vec<Row>) {
        let Self { condim, mu, d, ref jacobian, residual } = *self;
        let aref = |k: usize| -residual[k];
        if condim == 1 {
            rows.push(Row { kind, jacobian: jacobian[0].clone(), aref: aref(0), d });
            return;
        }
        for k in 0..condim {
            if tree.elliptic {
                // MuJoCo keeps R_k · μ_k² the same for all friction rows, and impratio times smaller than the
                // normal's.
                let scale = if k == 0 { 1.0 } else { tree.impratio * (mu[k - 1] / mu[0]).powi(2) };
                rows.push(Row { kind, jacobian: jacobian[k].clone(), aref: aref(k), d: d * scale });
            } else if k > 0 {
                // An edge is the normal plus or minus μ times a tangent, for its Jacobian and for its
                // reference.
                for sign in [1.0, -1.0] {
                    let m = sign * mu[k - 1];
                    rows.push(Row {
                        kind,
                        jacobian: jacobian[0].iter().zip(&jacobian[k]).map(|(n, t)| n + m * t).collect(),
                        aref: aref(0) + m * aref(k),
                        d,
                    });
                }
            }
        }
    }
}
