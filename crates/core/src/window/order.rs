//! In which order variables are eliminated: next the one that ties the fewest numbers together.

use std::collections::BTreeSet;

/// Sets of nodes, as bits.
#[derive(Debug, Clone)]
struct Sets {
    words: usize,
    bits: Vec<u64>,
}

impl Sets {
    fn new(count: usize) -> Self {
        let words = count.div_ceil(64);
        Self { words, bits: vec![0; words * count] }
    }

    fn of(&self, node: usize) -> &[u64] {
        &self.bits[node * self.words..(node + 1) * self.words]
    }

    fn insert(&mut self, node: usize, other: usize) {
        self.bits[node * self.words + other / 64] |= 1 << (other % 64);
    }

    fn remove(&mut self, node: usize, other: usize) {
        self.bits[node * self.words + other / 64] &= !(1 << (other % 64));
    }

    /// The members of a node's set, ascending.
    fn members(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        self.of(node).iter().enumerate().flat_map(|(word, bits)| {
            std::iter::successors(Some(*bits), |rest| Some(rest & rest.wrapping_sub(1)))
                .take_while(|rest| *rest != 0)
                .map(move |rest| 64 * word + rest.trailing_zeros() as usize)
        })
    }
}

/// The nodes in the order of their elimination, and the later nodes that each is then tied to.
#[derive(Debug, Clone, Default)]
pub(super) struct Order {
    pub nodes: Vec<usize>,
    pub tied: Vec<Vec<usize>>, // by position; positions, ascending
}

/// Minimum degree, measured in numbers; nodes of `last` come last, in their order. `cliques` are the factors' nodes.
pub(super) fn minimum_degree<'a>(widths: &[usize], cliques: impl Iterator<Item = &'a [u32]>, last: &[usize]) -> Order {
    let count = widths.len();
    let mut ties = Sets::new(count);
    for clique in cliques {
        for &a in clique {
            clique.iter().filter(|&&b| b != a).for_each(|&b| ties.insert(a as usize, b as usize));
        }
    }
    let degree = |ties: &Sets, node: usize| ties.members(node).map(|other| widths[other]).sum::<usize>();
    let mut degrees: Vec<usize> = (0..count).map(|node| degree(&ties, node)).collect();
    let mut is_last = vec![false; count];
    last.iter().for_each(|&node| is_last[node] = true);
    let mut waiting: BTreeSet<(usize, usize)> =
        (0..count).filter(|&node| !is_last[node]).map(|node| (degrees[node], node)).collect();
    let mut rest = last.iter().copied();
    let mut nodes = Vec::with_capacity(count);
    let mut tied_nodes = Vec::with_capacity(count);
    while let Some(node) = waiting.pop_first().map(|(_, node)| node).or_else(|| rest.next()) {
        let around: Vec<usize> = ties.members(node).collect();
        let words = ties.of(node).to_vec();
        for &other in &around {
            let start = other * ties.words;
            ties.bits[start..start + ties.words].iter_mut().zip(&words).for_each(|(mine, new)| *mine |= new);
            ties.remove(other, other);
            ties.remove(other, node);
            let before = (degrees[other], other);
            degrees[other] = degree(&ties, other);
            if waiting.remove(&before) {
                waiting.insert((degrees[other], other));
            }
        }
        nodes.push(node);
        tied_nodes.push(around);
    }
    let mut position = vec![0; count];
    nodes.iter().enumerate().for_each(|(at, &node)| position[node] = at);
    let to_positions = |around: Vec<usize>| {
        let mut found: Vec<usize> = around.into_iter().map(|node| position[node]).collect();
        found.sort_unstable();
        found
    };
    Order { nodes, tied: tied_nodes.into_iter().map(to_positions).collect() }
}
