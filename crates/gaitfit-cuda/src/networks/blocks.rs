//! How robots are shared among blocks and threads of the kernels that run a policy's networks.

/// Threads for a group of robots. With layers of 128 numbers no thread is idle.
const THREADS_OF_GROUP: u32 = 128;
/// Max number of threads of a block, in groups.
const MAX_GROUPS: usize = 4;

/// Max number of full blocks of a multiprocessor whose threads take 8 robots instead of 16.
const MAX_SMALLER: usize = 4;

/// Robots of a block and of a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Blocks {
    /// Robots of a block, a multiple of 4.
    pub rows: usize,
    /// Robots of a thread, a multiple of 4 that divides `rows`.
    pub group: usize,
}

impl Blocks {
    /// Max number of robots of a block.
    pub const MAX_ROWS: usize = 16;
    /// Max bytes of shared memory that the kernels' texts declare themselves.
    pub const DECLARED: usize = 1024;
    /// The smallest block that the kernels take: it needs the least shared memory.
    pub const SMALLEST: Self = Self { rows: 4, group: 4 };

    /// For so many robots on a GPU with so many multiprocessors: one wave of blocks, if it can be.
    pub fn new(robots: usize, processors: usize) -> Self {
        let rows = robots.div_ceil(processors).next_multiple_of(4).clamp(4, Self::MAX_ROWS);
        // Few robots want many threads; of many, threads that read each weight for several of them. On an H200 groups of 8
        // are a sixth faster with 6,144 robots, and those of 16 with 12,288.
        let group = match robots.div_ceil(Self::MAX_ROWS * processors) {
            ..=1 => 4,
            2..=MAX_SMALLER => rows.min(8),
            _ => rows,
        };
        Self { rows, group }
    }

    /// Threads of a block.
    pub fn threads(self) -> u32 {
        (self.rows / self.group.max(1)).clamp(1, MAX_GROUPS) as u32 * THREADS_OF_GROUP
    }

    /// Blocks for so many robots.
    pub fn count(self, robots: usize) -> u32 {
        u32::try_from(robots.div_ceil(self.rows.max(1))).unwrap_or(u32::MAX)
    }
}
