//! What can be wrong with a pickle.

use super::node::MAX_NODES;
use gaitfit_model::{escaped, shown};

/// What is wrong with a pickle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PickleError {
    /// It ends within an instruction, or has no end.
    #[error("cut short")]
    CutShort,
    /// A line's bytes are no UTF-8.
    #[error("a line is no text")]
    NotText,
    /// A number in digits that is none.
    #[error("`{}` is no number", shown(.0))]
    NotANumber(String),
    /// An integer that no log holds.
    #[error("an integer of more than a thousand bytes")]
    LongInteger,
    /// An instruction that no plain data needs.
    #[error("instruction 0x{0:02x} is not read; save plain arrays: np.savez(\"log.npz\", q=..., dq=...)")]
    Instruction(u8),
    /// It would take too much memory.
    #[error("more than {MAX_NODES} objects; save plain arrays")]
    TooManyObjects,
    /// An instruction needs an object, and there is none.
    #[error("an instruction finds nothing on the stack")]
    EmptyStack,
    /// An instruction needs more objects than there are.
    #[error("an instruction finds too little on the stack")]
    ShortStack,
    /// An instruction takes all objects above a mark, and there is none.
    #[error("an instruction finds no mark")]
    NoMark,
    /// The number under which an object is remembered.
    #[error("a memo's number is none")]
    MemoNumber,
    /// An object under a number that none was remembered under.
    #[error("an object is used that is not there")]
    NotRemembered,
    /// Items for an object that takes none.
    #[error("items are added to what is no list")]
    NotAList,
    /// Entries for an object that takes none.
    #[error("items are set in what is no dictionary")]
    NotADictionary,
    /// An odd number of objects for a dictionary.
    #[error("a dictionary has a key without a value")]
    KeyWithoutValue,
    /// A class whose name is no text.
    #[error("the name of a class is no text")]
    ClassName,
    /// A call of an object that is no function.
    #[error("it calls what is no function")]
    NotAFunction,
    /// A known function with unknown arguments.
    #[error("`{}` is called in a way that is not known", escaped(.0, 200))]
    Arguments(String),
    /// A function that does not make plain data. It is not called.
    #[error(
        "it calls `{}`, which is no plain data. Nothing was run. Save plain arrays instead: np.savez(\"log.npz\", \
         q=..., dq=...)",
        escaped(.0, 200)
    )]
    NotData(String),
    /// An object whose class sets its state by code. The code is not run.
    #[error("an object of a class that is no plain data. Nothing was run. Save plain arrays instead")]
    State,
    /// A type of NumPy that is no number.
    #[error("arrays of NumPy's type `{}` are not read; save numbers: np.asarray(x, dtype=float)", escaped(.0, 60))]
    Type(String),
    /// Objects in an array.
    #[error("a NumPy array of objects; save numbers: np.asarray(x, dtype=float)")]
    ArrayOfObjects,
    /// An array with more or fewer bytes than its shape needs.
    #[error("a NumPy array's bytes do not fit its shape")]
    ArraySize,
    /// A shape that no log has.
    #[error("an array of too many axes")]
    Axes,
    /// A shape of other objects.
    #[error("an array's shape is no numbers")]
    Shape,
    /// A negative, broken or huge number where a size is.
    #[error("an array's shape or offset is no size")]
    Size,
    /// A reference to what is outside the pickle.
    #[error("a reference that PyTorch does not make")]
    Reference,
    /// A type of PyTorch that is no number.
    #[error("numbers of `{}` are not read; save x.double() or x.float()", escaped(.0, 60))]
    Storage(String),
    /// A tensor in a pickle that is in no archive.
    #[error("a tensor whose numbers are in no file")]
    NoStorage,
    /// A tensor with more numbers than its storage.
    #[error("a tensor reaches beyond its storage; the file is damaged")]
    BeyondStorage,
    /// No numbers at all.
    #[error("it holds no dictionary of arrays of numbers; save {{\"time\": ..., \"q\": ..., \"dq\": ...}}")]
    NoArrays,
}
