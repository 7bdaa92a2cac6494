//! The block of one segment in the Newton system, and what contacts and carried bodies add to it (see [`crate::segment`]).

use crate::Real;
use crate::spatial::{Articulated, V6, add6, dot6_add, merge6};
use crate::state::{SegmentWork, Work};
use crate::tree::{SEGMENT, Tree};
use crate::vec3::*;

/// The joints' part of one segment's block while it is put together.
#[derive(Clone, Copy)]
pub(crate) struct Block<T> {
    /// 00, 11, 22, 10, 20, 21.
    pub h: [T; 6],
    pub r: [T; SEGMENT],
}

/// Place of element (k, i), k > i, in a packed symmetric 3 × 3 matrix.
#[inline(always)]
pub(crate) fn below(k: usize, i: usize) -> usize {
    2 + k + i
}

impl<T: Real> Block<T> {
    /// After a region that added to the block: see [`Real::merge`].
    #[inline(always)]
    fn merge(&mut self, guard: T::Guard, before: &Self) {
        merge_all(&mut self.h, guard, &before.h);
        merge_all(&mut self.r, guard, &before.r);
    }
}

/// Adds an inertia and a residual wrench that the link `member` of the segment `scratch` carries.
#[inline(always)]
pub(crate) fn carry<T: Real, const N: usize>(
    member: usize,
    inertia: &Articulated<T>,
    wrench: V6<T>,
    block: &mut Block<T>,
    scratch: &mut SegmentWork<T>,
) {
    let axis = &scratch.axis;
    for k in 0..N {
        if k <= member {
            let force = inertia.mul(axis[k]);
            scratch.coupling[k] = add6(scratch.coupling[k], force);
            block.h[k] = dot6_add(axis[k], force, block.h[k]);
            for i in 0..k {
                block.h[below(k, i)] = dot6_add(axis[i], force, block.h[below(k, i)]);
            }
            block.r[k] = dot6_add(axis[k], wrench, block.r[k]);
        }
    }
}

/// Adds the contacts of the segment's links to the joints' part of its block and to the node.
#[inline(always)]
pub(crate) fn segment_contacts<T: Real, const N: usize>(
    tree: &Tree<T::K>,
    index: usize,
    hessian: bool,
    block: &mut Block<T>,
    work: &mut Work<T>,
) {
    let segment = &tree.segments[index];
    for number in segment.pairs.clone() {
        let pair = &tree.pairs[number];
        let active = work.pairs[number].active;
        if !T::enter(active) {
            continue;
        }
        let parent = &mut work.nodes[segment.parent];
        let scratch = &mut work.segments[index];
        let before = (*block, parent.inertia, parent.residual, scratch.coupling);
        for (place, point) in work.points[pair.points.clone()].iter_mut().enumerate() {
            if pair.condim > 3 {
                let (wrench, inertia) = &work.spins[pair.spin + place];
                let inertia = if hessian { *inertia } else { Articulated::zero() };
                carry::<T, N>(pair.member, &inertia, *wrench, block, scratch);
                parent.inertia.add(&inertia);
                parent.residual = add6(parent.residual, *wrench);
                continue;
            }
            for k in 0..N {
                if k <= pair.member {
                    let g = point.columns[k];
                    block.r[k] = dot_add(g, point.world_force, block.r[k]);
                    if hessian {
                        let y = sym_mul(&point.weight, g);
                        point.pushed[k] = y;
                        block.h[k] = dot_add(g, y, block.h[k]);
                        for i in 0..k {
                            let place = below(k, i);
                            block.h[place] = dot_add(point.columns[i], y, block.h[place]);
                        }
                    }
                }
            }
            parent.push(point, hessian);
        }
        T::leave(active);
        block.merge(active, &before.0);
        parent.inertia.merge(active, &before.1);
        merge6(&mut parent.residual, active, &before.2);
        if pair.condim > 3 {
            merge_forces(&mut scratch.coupling, active, &before.3);
        }
    }
}

/// Adds the contacts of three dimensions to the coupling `f` of the segment's joints to its node.
#[inline(always)]
pub(crate) fn contact_couplings<T: Real, const N: usize>(
    tree: &Tree<T::K>,
    index: usize,
    f: &mut [V6<T>; SEGMENT],
    work: &Work<T>,
) {
    for number in tree.segments[index].pairs.clone() {
        let pair = &tree.pairs[number];
        let active = work.pairs[number].active;
        if pair.condim > 3 || !T::enter(active) {
            continue;
        }
        let before = *f;
        for point in &work.points[pair.points.clone()] {
            for k in 0..N {
                if k <= pair.member {
                    let y = point.pushed[k];
                    f[k] = [cross_add(point.x, y, f[k][0]), add(f[k][1], y)];
                }
            }
        }
        T::leave(active);
        merge_forces(f, active, &before);
    }
}

/// After a region that added to the forces: see [`Real::merge`].
#[inline(always)]
fn merge_forces<T: Real>(forces: &mut [V6<T>; SEGMENT], guard: T::Guard, before: &[V6<T>; SEGMENT]) {
    for k in 0..SEGMENT {
        merge6(&mut forces[k], guard, &before[k]);
    }
}
