//! Every number of a state, a scratch or a parameter set, with its name: for code that copies, compares, stores or
//! records them without a list of fields of its own.

use core::fmt;

/// What a number belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Owner {
    /// The floating base, or the robot as a whole.
    Base,
    /// A link of the compiled tree; 0 is the root.
    Link(usize),
    /// A joint of the model.
    Joint(usize),
    /// A compiled contact pair.
    Pair(usize),
}

/// Name and place of a number. No two numbers of one object have the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Slot {
    /// What it belongs to.
    pub owner: Owner,
    /// Its name, as the field's.
    pub name: &'static str,
    /// Its place, where several numbers have one name.
    pub index: usize,
}

impl Slot {
    /// A single number.
    pub(crate) fn new(owner: Owner, name: &'static str) -> Self {
        Self { owner, name, index: 0 }
    }
}

/// For example `base.position.2` or `joint3.kp.0`.
impl fmt::Display for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.owner {
            Owner::Base => f.write_str("base")?,
            Owner::Link(i) => write!(f, "link{i}")?,
            Owner::Joint(j) => write!(f, "joint{j}")?,
            Owner::Pair(p) => write!(f, "pair{p}")?,
        }
        write!(f, ".{}.{}", self.name, self.index)
    }
}

/// Visits `numbers` with indices from that of `first`.
pub(crate) fn all<R>(visit: &mut impl FnMut(Slot, R), first: Slot, numbers: impl IntoIterator<Item = R>) {
    for (number, index) in numbers.into_iter().zip(first.index..) {
        visit(Slot { index, ..first }, number);
    }
}

/// Methods `visit` and `visit_mut` of a type from its list of numbers, a macro with the arguments: the object, the
/// visitor, `numbers` or `numbers_mut`, and `&` or `&mut`; then those of the methods.
macro_rules! visit_methods {
    ($list:ident $(, $argument:ident: $type:ty)?) => {
        /// Calls `visit` with every number and its name, always in the same order.
        #[allow(clippy::into_iter_on_ref, reason = "the list serves `&` and `&mut` alike")]
        pub fn visit<'a>(&'a self, $($argument: $type,)? mut visit: impl FnMut(Slot, &'a T)) {
            $list!(self, visit, numbers, [&] $(, $argument)?);
        }

        /// As `visit`, to change the numbers.
        #[allow(clippy::into_iter_on_ref, reason = "the list serves `&` and `&mut` alike")]
        pub fn visit_mut<'a>(&'a mut self, $($argument: $type,)? mut visit: impl FnMut(Slot, &'a mut T)) {
            $list!(self, visit, numbers_mut, [&mut] $(, $argument)?);
        }
    };
}
pub(crate) use visit_methods;
