/// Sets of things numbered from 0 that are joined two by two; each set is named by its smallest member.
#[derive(Debug)]
pub(super) struct Forest {
    /// An earlier member of the same set; the smallest points at itself.
    parent: Vec<u32>,
}

impl Forest {
    /// `count` sets of one; more than 32 bits count were refused earlier.
    pub(super) fn new(count: u32) -> Self {
        Self { parent: (0..count).collect() }
    }

    /// Makes one set of those of `a` and `b`.
    pub(super) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// The smallest member of the set of `member`; halves the path to it on the way.
    pub(super) fn root(&mut self, mut member: u32) -> u32 {
        loop {
            let up = self.parent[member as usize];
            if up == member {
                return member;
            }
            self.parent[member as usize] = self.parent[up as usize];
            member = up;
        }
    }
}
