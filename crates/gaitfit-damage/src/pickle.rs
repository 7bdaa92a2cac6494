//! Pickles that no `pickle.dump` writes: programs of its stack machine (Python's `pickletools` documents the instructions).

use crate::Draws;

/// Classes and functions that logs name, and some that no log may.
const NAMES: &[&str] = &[
    "collections\nOrderedDict",
    "builtins\nlist",
    "builtins\nset",
    "builtins\nbytearray",
    "_codecs\nencode",
    "numpy\ndtype",
    "numpy._core.multiarray\n_reconstruct",
    "numpy._core.multiarray\nscalar",
    "numpy._core.numeric\n_frombuffer",
    "torch._utils\n_rebuild_tensor_v2",
    "torch\nFloatStorage",
    "os\nsystem",
];
const TEXTS: &[&str] = &["dq", "joint_names", "q_des", "kp", "kd", "cmd", "quat", "storage", ""];

/// Max number of objects that a program remembers: their numbers are one byte.
const MAX_KNOWN: usize = 250;

/// A program that makes a dictionary: times and positions of twelve joints, then up to `entries` others, which are made of
/// each other. One instruction in sixty is wild.
pub fn pickle(entries: usize, draws: &mut Draws) -> Vec<u8> {
    // PROTO 4.
    let mut program = Program { out: vec![0x80, 4], known: 0 };
    // Objects that others are made of, remembered under their numbers: a large text, large bytes, a type, a shape, small ones.
    for (code, size) in [(b'X', 2048u32), (b'B', 2048)] {
        program.out.push(code);
        program.out.extend(size.to_le_bytes());
        program.out.extend(std::iter::repeat_n(b'1', size as usize));
        program.remember();
    }
    for kind in ["<f8", "S1", "S2048", "<U512"] {
        program.dtype(kind);
        program.remember();
    }
    for object in [b"K\x02K\x01\x86".as_slice(), b"K\x02", b"]", b"}", b"N", b"\x8c\x01C", b"\x8c\x06latin1"]
    {
        program.out.extend(object);
        program.remember();
    }
    // POP: the objects stay in the memo, and the stack is empty again.
    program.out.extend(std::iter::repeat_n(b'0', program.known));
    // EMPTY_DICT and MARK: what follows are keys and values until SETITEMS.
    program.out.extend(b"}(");
    let rows = 2 + draws.below(4);
    program.text("time");
    program.array("<f8", &[rows], |i| 0.02 * i as f64);
    program.text("q");
    program.array("<f8", &[rows, 12], |i| 0.01 * i as f64);
    for _ in 0..draws.below(entries) {
        if draws.below(2) == 0 {
            program.text(draws.one::<&str>(TEXTS));
        } else {
            program.text(&draws.below(1000).to_string());
        }
        program.value(draws);
        if draws.below(2) == 0 {
            program.remember();
        }
        if draws.below(60) == 0 {
            program.wild(draws);
        }
    }
    // SETITEMS and STOP.
    program.out.extend(b"u.");
    program.out
}

struct Program {
    out: Vec<u8>,
    /// Objects that are remembered.
    known: usize,
}

impl Program {
    fn remember(&mut self) {
        if self.known < MAX_KNOWN {
            // BINPUT
            self.out.extend([b'q', self.known as u8]);
            self.known += 1;
        }
    }

    fn get(&mut self, number: usize) {
        // BINGET
        self.out.extend([b'h', number as u8]);
    }

    fn text(&mut self, text: &str) {
        // SHORT_BINUNICODE
        self.out.extend([0x8c, text.len() as u8]);
        self.out.extend(text.bytes());
    }

    fn dtype(&mut self, kind: &str) {
        // GLOBAL, and below TUPLE1 and REDUCE: a call with one argument.
        self.out.extend(b"cnumpy\ndtype\n");
        self.text(kind);
        self.out.extend(b"\x85R");
    }

    /// An array of numbers.
    fn array(&mut self, kind: &str, shape: &[usize], number: impl Fn(usize) -> f64) {
        self.out.extend(b"cnumpy._core.numeric\n_frombuffer\n(B");
        let count: usize = shape.iter().product();
        self.out.extend((8 * count as u32).to_le_bytes());
        self.out.extend((0..count).flat_map(|i| number(i).to_le_bytes()));
        self.dtype(kind);
        self.out.push(b'(');
        shape.iter().for_each(|size| self.out.extend([b'K', *size as u8]));
        self.out.extend(b"t\x8c\x01CtR");
    }

    /// Pushes one object. What it is made of is remembered objects.
    fn value(&mut self, draws: &mut Draws) {
        let any = |draws: &mut Draws, program: &Self| draws.below(program.known);
        match draws.below(12) {
            0 => self.out.extend([b'K', draws.below(256) as u8]),
            1 => {
                let number = any(draws, self);
                self.get(number);
            }
            // Many times the same in a list.
            2 | 3 => {
                self.out.push(b'(');
                let same = any(draws, self);
                (0..draws.below(100)).for_each(|_| self.get(same));
                // LIST, TUPLE or FROZENSET of what follows the MARK.
                self.out.push(*draws.one(b"lt\x91"));
            }
            4 => {
                self.out.push(b'(');
                for _ in 0..draws.below(6) {
                    let number = any(draws, self);
                    self.get(number);
                }
                self.out.push(b'l');
            }
            // A dictionary, of which the keys may be long.
            5 | 6 => {
                self.out.push(b'(');
                for _ in 0..draws.below(6) {
                    self.get(if draws.below(2) == 0 { 0 } else { 7 });
                    let number = any(draws, self);
                    self.get(number);
                }
                self.out.push(b'd');
            }
            // A class named by two long texts: STACK_GLOBAL takes module and name from the stack.
            7 => self.out.extend(b"h\0h\0\x93"),
            8 => self.array(
                draws.one::<&str>(&["<f8", ">f8", "<i8", "S8", "<U2"]),
                &[draws.below(5), draws.below(4)],
                |i| f64::from_bits(0x3131_3131_3131_3131 + i as u64),
            ),
            // A word of a long text, or an array that is a view of the same bytes.
            9 => self.out.extend(b"cnumpy._core.multiarray\nscalar\nh\x04h\x01\x86R"),
            10 => self.out.extend(b"cnumpy._core.numeric\n_frombuffer\n(h\x01h\x03(M\0\x08th\x0btR"),
            _ => self.call(draws),
        }
    }

    /// A call with any remembered objects: most are refused.
    fn call(&mut self, draws: &mut Draws) {
        if draws.below(8) > 0 {
            // A call that all programs may make.
            self.out.extend(b"c_codecs\nencode\nh\0h\x0c\x86R");
            return;
        }
        self.out.push(b'c');
        self.out.extend(draws.one(NAMES).bytes());
        self.out.extend(b"\n(");
        for _ in 0..draws.below(5) {
            let number = draws.below(self.known);
            self.get(number);
        }
        self.out.extend(b"tR");
    }

    /// An instruction that need not fit.
    fn wild(&mut self, draws: &mut Draws) {
        match draws.below(3) {
            0 => self.out.push(draws.below(256) as u8),
            1 => self.out.push(*draws.one(b"(012ltdaesub\x85\x86\x87\x8f\x90\x91\x93N]}.")),
            _ => {
                let number = draws.below(256);
                self.get(number);
            }
        }
    }
}
