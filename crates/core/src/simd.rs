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

/// Numbers that are handled at once: so many that the loop over them stays one and is made of whole vectors.
pub(crate) const LANES: usize = 64;

/// Those of many flags that are not 0, in their order.
pub(crate) struct Raised<'a> {
    flags: &'a [u8; LANES],
    word: usize,
    left: u64,
}

impl<'a> Raised<'a> {
    #[inline(always)]
    pub fn new(flags: &'a [u8; LANES]) -> Self {
        Self { flags, word: 0, left: word(flags, 0) }
    }
}

/// Eight flags from eight times an index on, as one number.
#[inline(always)]
fn word(flags: &[u8; LANES], at: usize) -> u64 {
    flags.as_chunks::<8>().0.get(at).map_or(0, |eight| u64::from_le_bytes(*eight))
}

impl Iterator for Raised<'_> {
    type Item = (usize, u8);

    #[inline(always)]
    fn next(&mut self) -> Option<Self::Item> {
        while self.left == 0 {
            self.word += 1;
            if self.word >= LANES / 8 {
                return None;
            }
            self.left = word(self.flags, self.word);
        }
        let bit = self.left.trailing_zeros() & !7;
        let flag = (self.left >> bit) as u8;
        self.left &= !(0xff << bit);
        Some((8 * self.word + bit as usize / 8, flag))
    }
}
