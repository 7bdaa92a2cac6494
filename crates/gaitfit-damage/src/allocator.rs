//! An allocator that counts the memory of each thread.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Bytes that this thread has allocated and not freed, and the maximum since [`peak`] began.
    static LIVE: Cell<(usize, usize)> = const { Cell::new((0, 0)) };
}

/// The system's allocator, which counts what each thread takes.
pub struct Counting;

fn count(taken: usize, freed: usize) {
    // A thread that ends frees memory after its count is gone.
    let _ = LIVE.try_with(|live| {
        let (now, most) = live.get();
        // Memory that another thread took is freed without having been counted here.
        let now = now.saturating_add(taken).saturating_sub(freed);
        live.set((now, most.max(now)));
    });
}

#[allow(
    unsafe_code,
    reason = "every call goes to the system's allocator as it came; counting touches no memory of it"
)]
// SAFETY: the contract of `GlobalAlloc` is that of `System`, to which all calls go with their arguments unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: the caller keeps the contract of `alloc_zeroed`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(0, layout.size());
        // SAFETY: `pointer` is of this allocator, so of the system's, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both blocks may exist while the content is moved.
        count(size, 0);
        count(0, layout.size());
        // SAFETY: `pointer` is of this allocator, so of the system's, with this layout; the caller checked `size`.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

/// Result of `work`, and the maximum of the bytes that this thread held at a time beyond those that it held before.
/// 0 bytes where the program's allocator is not [`Counting`].
pub fn peak<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = LIVE.with(|live| {
        let (now, _) = live.get();
        live.set((now, now));
        now
    });
    let result = work();
    let most = LIVE.with(|live| live.get().1);
    (result, most.saturating_sub(before))
}
