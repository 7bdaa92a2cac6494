//! The nonzero pattern of the Hessian with self-contacts and distant couplings.
//!
//! The unknowns are eliminated from the outermost joints inwards, the base last (Featherstone 2008, section 6.5). Along a tree
//! this fills nothing in. What couples two limbs fills in elements of the joints that carry them.

/// Place of element (i, j), i ≥ j, of a lower triangle by rows.
#[inline(always)]
pub(crate) fn at(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

/// The order of the unknowns, and the nonzero rows of each column of the factor.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sparsity {
    joints: usize,
    below: Vec<Vec<usize>>,
}

impl Sparsity {
    /// `parents`: of each joint, the joint that carries it. `coupled`: sets of joints that a contact or a coupling connects.
    pub fn new(parents: &[Option<usize>], floating: bool, coupled: &[Vec<usize>]) -> Self {
        let joints = parents.len();
        let size = joints + if floating { 6 } else { 0 };
        let mut sparsity = Self { joints, below: Vec::new() };
        let mut filled = vec![false; size * (size + 1) / 2];
        for joint in 0..joints {
            let mut next = parents[joint];
            // The inertia of a link couples all the joints that carry it.
            while let Some(carrier) = next {
                filled[sparsity.joints(joint, carrier)] = true;
                next = parents[carrier];
            }
        }
        for set in coupled {
            for (number, &joint) in set.iter().enumerate() {
                set[number + 1..].iter().for_each(|&other| filled[sparsity.joints(joint, other)] = true);
            }
        }
        // The base is coupled with everything.
        for row in joints..size {
            (0..row).for_each(|column| filled[at(row, column)] = true);
        }
        // Elimination of column k, in symbols: each pair of its nonzero rows becomes a nonzero element.
        for k in 0..size {
            let below: Vec<usize> = (k + 1..size).filter(|&row| filled[at(row, k)]).collect();
            for (number, &j) in below.iter().enumerate() {
                below[number + 1..].iter().for_each(|&i| filled[at(i, j)] = true);
            }
            sparsity.below.push(below);
        }
        sparsity
    }

    /// Place of a joint among the unknowns.
    #[inline(always)]
    pub fn joint(&self, joint: usize) -> usize {
        // Joints with higher numbers lie further out, and are eliminated first.
        self.joints - 1 - joint
    }

    /// Place of a component of the base's acceleration (angular, then linear).
    #[inline(always)]
    pub fn base(&self, component: usize) -> usize {
        self.joints + component
    }

    /// Place of the element of two joints in the matrix.
    #[inline(always)]
    pub fn joints(&self, a: usize, b: usize) -> usize {
        // The joint with the lower number comes later in the elimination, so it is the row.
        at(self.joint(a.min(b)), self.joint(a.max(b)))
    }

    /// Place of the element of a component of the base and a joint.
    #[inline(always)]
    pub fn base_and_joint(&self, component: usize, joint: usize) -> usize {
        at(self.base(component), self.joint(joint))
    }

    /// Place of the element of two components of the base, a ≥ b.
    #[inline(always)]
    pub fn bases(&self, a: usize, b: usize) -> usize {
        at(self.base(a), self.base(b))
    }

    /// The columns in the order of elimination, each with its nonzero rows below the diagonal.
    #[inline(always)]
    pub fn columns(&self) -> impl DoubleEndedIterator<Item = (usize, &[usize])> {
        self.below.iter().enumerate().map(|(column, rows)| (column, &rows[..]))
    }

    /// Places of all nonzero elements.
    pub fn places(&self) -> impl Iterator<Item = usize> {
        self.columns().flat_map(|(k, below)| below.iter().map(move |&j| at(j, k)).chain([at(k, k)]))
    }
}
