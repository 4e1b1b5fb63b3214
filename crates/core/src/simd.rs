//! Loops compiled for the widest vectors that the machine has.
//!
//! Only the width changes: no sum is reordered, and a product is fused with a sum where `mul_add` says so, which rounds once on
//! every machine. So results are the same to the bit everywhere; where there is no such instruction they come slowly.

use pulp::Arch;

/// Run a loop compiled for several vector widths; the widest that this machine knows is chosen. What the closure calls
/// must be inlined into it to profit.
#[inline]
pub(crate) fn wide<R>(body: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(body)
}
