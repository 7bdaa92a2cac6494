//! States evaluated by MuJoCo held against the engine: mass matrix, bias, rows, accelerations, next state.

use gaitfit_model::{Cone, Model};
use gaitfit_physics::{Forward, Row, RowKind, Settings, Work, constraint_rows, state_from, state_to};

use super::{Arrays, Ledger, difference, largest, relative, relative_1};

/// Values of `efc_type`.
const EQUALITY: f64 = 0.0;
const FRICTION: f64 = 1.0;
const LIMIT: f64 = 3.0;

/// Allowed relative errors.
pub struct Limits {
    pub dense: f64,
    pub rows: f64,
    pub solution: f64,
}

impl Limits {
    /// The project's promise: 1e-12, 1e-9, and for solutions 1e-9 with pyramids, 1e-6 with ellipses.
    pub fn promised(model: &Model) -> Self {
        let solution = if model.options.cone == Cone::Elliptic { 1e-6 } else { 1e-9 };
        Self { dense: 1e-12, rows: 1e-9, solution }
    }
}

/// Link number of every body: the last hinge that carries it, from 1; 0 for the root.
pub fn body_links(model: &Model) -> Vec<usize> {
    let mut links: Vec<usize> = Vec::new();
    for (index, body) in model.bodies.iter().enumerate() {
        let own = model.joints.iter().rposition(|joint| joint.body == index);
        links.push(own.map_or_else(|| body.parent.map_or(0, |p| links[p]), |j| j + 1));
    }
    links
}

/// `dof_invweight0` of joints and `body_invweight0` of bodies with contact pairs.
pub fn invweights(label: &str, model: &Model, forward: &Forward, data: &Arrays, ledger: &mut Ledger) {
    let params = forward.params();
    let first = model.nv() - model.joints.len();
    let want = &data.all("dof_invweight0")[first..];
    for (joint, want) in params.joints.iter().zip(want) {
        ledger.note("dof_invweight0", (1.0 / joint.weight / want - 1.0).abs(), 1e-9, || label.to_owned());
    }
    let links = body_links(model);
    let mut pairs: Vec<_> = model.pairs.iter().collect();
    pairs.sort_by_key(|pair| links[model.geoms[pair.geom].body]);
    assert_eq!(pairs.len() + model.self_pairs.len(), params.pairs.len());
    for (pair, got) in pairs.iter().zip(&params.pairs) {
        let want = data.row("body_invweight0", model.geoms[pair.geom].body + 1);
        let got = [got.translation, got.rotation];
        for (got, want) in got.iter().zip(want) {
            ledger.note("body_invweight0", (got / want - 1.0).abs(), 1e-9, || label.to_owned());
        }
    }
}

/// Everything of every state of `data`. `next` lists (steps, prefix of the arrays).
pub fn states(
    label: &str,
    model: &Model,
    settings: &Settings,
    data: &Arrays,
    next: &[(usize, &str)],
    limits: &Limits,
    ledger: &mut Ledger,
) {
    let mut forward = Forward::new(model, settings).unwrap();
    invweights(label, model, &forward, data, ledger);
    for index in 0..data.len("qpos") {
        let place = |what: &str| format!("{label} state {index} {what}");
        let (qpos, qvel) = (data.row("qpos", index), data.row("qvel", index));
        let ctrl = data.row("ctrl", index);
        let got = forward.evaluate(qpos, qvel, ctrl).unwrap();
        ledger.note("M", relative(&got.mass, data.row("M", index)), limits.dense, || place(""));
        let bias = relative(&got.qfrc_bias, data.row("qfrc_bias", index));
        ledger.note("qfrc_bias", bias, limits.dense, || place(""));

        let state = state_from(forward.tree(), qpos, qvel).unwrap();
        let mut work = Work::new(forward.tree());
        let rows = constraint_rows(forward.tree(), forward.params(), &state, &mut work);
        compare_rows(model, &rows, data, index, &place, limits, ledger);

        let qacc = relative_1(&got.qacc, data.row("qacc", index));
        ledger.note("qacc", qacc, limits.solution, || place(""));
        for &(steps, prefix) in next {
            let mut state = state_from(forward.tree(), qpos, qvel).unwrap();
            for _ in 0..steps {
                forward.step(&mut state, ctrl).unwrap();
            }
            let (q, v) = state_to(forward.tree(), &state);
            let q = relative_1(&q, data.row(&format!("{prefix}_qpos"), index));
            let v = relative_1(&v, data.row(&format!("{prefix}_qvel"), index));
            // What one step may be off by grows with the steps.
            let limit = limits.solution * if steps == 1 { 1.0 } else { 100.0 };
            ledger.note(&format!("{prefix}_qpos"), q, limit, || place(""));
            ledger.note(&format!("{prefix}_qvel"), v, limit, || place(""));
            if steps == 1 {
                assert_eq!(
                    (&got.next_qpos, &got.next_qvel),
                    (&state_to(forward.tree(), &state).0, &state_to(forward.tree(), &state).1)
                );
            }
        }
    }
}

/// One row of the reference.
struct Reference<'a> {
    jacobian: &'a [f64],
    aref: f64,
    d: f64,
}

fn compare_rows(
    model: &Model,
    rows: &[Row],
    data: &Arrays,
    index: usize,
    place: &dyn Fn(&str) -> String,
    limits: &Limits,
    ledger: &mut Ledger,
) {
    let count = data.row("nefc", index)[0] as usize;
    let nv = model.nv();
    let first_dof = nv - model.joints.len();
    // The free joint is MuJoCo's joint 0 where there is one.
    let first_joint = usize::from(first_dof > 0);
    let (kinds, ids) = (data.row("efc_type", index), data.row("efc_id", index));
    let reference = |r: usize| Reference {
        jacobian: &data.row("efc_J", index)[r * nv..(r + 1) * nv],
        aref: data.row("efc_aref", index)[r],
        d: data.row("efc_D", index)[r],
    };
    assert_eq!(rows.len(), count, "number of rows, {}", place(""));

    let mut at = 0;
    while at < count && kinds[at] == EQUALITY {
        assert_eq!(rows[at].kind, RowKind::Coupling(at), "kind of row {at}, {}", place(""));
        let want = reference(at);
        compare_row(&rows[at], &want, want.aref, &|| place(&format!("row {at}")), limits, ledger);
        at += 1;
    }
    while at < count && (kinds[at] == FRICTION || kinds[at] == LIMIT) {
        let id = ids[at] as usize;
        let want = match kinds[at] == FRICTION {
            true if id < first_dof => RowKind::Free(id),
            true => RowKind::Friction(id - first_dof),
            false => RowKind::Limit(id - first_joint),
        };
        assert_eq!(rows[at].kind, want, "kind of row {at}, {}", place(""));
        let want = reference(at);
        compare_row(&rows[at], &want, want.aref, &|| place(&format!("row {at}")), limits, ledger);
        at += 1;
    }

    // Contacts in any order: each of MuJoCo's takes the nearest unused one of the same geom, or of own parts.
    let mut groups: Vec<(Option<usize>, Vec<&Row>)> = Vec::new();
    let mut last = None;
    for row in &rows[at..] {
        let geom = match row.kind {
            RowKind::Contact(pair, _) => Some(model.pairs[pair].geom),
            RowKind::SelfContact(..) => None,
            other => panic!("{other:?} after the limits"),
        };
        if last != Some(row.kind) {
            groups.push((geom, Vec::new()));
            last = Some(row.kind);
        }
        groups.last_mut().unwrap().1.push(row);
    }
    while at < count {
        let contact = ids[at];
        let members: Vec<Reference> =
            (at..count).take_while(|&r| ids[r] == contact).map(&reference).collect();
        at += members.len();
        let own = data.has("contact_own") && data.row("contact_own", index)[contact as usize] == 1.0;
        let geom = data
            .has("contact_geom")
            .then(|| (!own).then(|| data.row("contact_geom", index)[contact as usize] as usize));
        let distance = |group: &[&Row]| -> f64 {
            group.iter().zip(&members).map(|(row, want)| difference(&row.jacobian, want.jacobian)).sum()
        };
        let best = (0..groups.len())
            .filter(|&g| geom.is_none_or(|geom| groups[g].0 == geom) && groups[g].1.len() == members.len())
            .min_by(|&a, &b| distance(&groups[a].1).total_cmp(&distance(&groups[b].1)))
            .unwrap_or_else(|| panic!("no contact of geom {geom:?}, {}", place("")));
        let (_, group) = groups.swap_remove(best);
        // The components of one contact's reference acceleration are one vector: one may vanish.
        let most = members.iter().fold(0.0, |most, want| f64::max(most, want.aref.abs()));
        for (row, want) in group.iter().zip(&members) {
            compare_row(row, want, most, &|| place(&format!("{:?}", row.kind)), limits, ledger);
        }
    }
    assert!(groups.is_empty(), "contacts MuJoCo does not have, {}", place(""));
}

fn compare_row(
    row: &Row,
    want: &Reference,
    most: f64,
    place: &dyn Fn() -> String,
    limits: &Limits,
    ledger: &mut Ledger,
) {
    let scale = largest(want.jacobian).max(1.0);
    ledger.note("rows J", difference(&row.jacobian, want.jacobian) / scale, limits.rows, place);
    let aref = (row.aref - want.aref).abs() / most.abs().max(1.0);
    ledger.note("rows aref", aref, limits.rows, place);
    ledger.note("rows D", (row.d / want.d - 1.0).abs(), limits.rows, place);
}
