//! Damage to files: bytes, numbers, lengths and order.
#![warn(missing_docs, clippy::unwrap_used)]

/// A small generator of random numbers (steele2014).
pub struct Random(u64);

impl Random {
    /// The generator with this seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    #[expect(clippy::should_implement_trait, reason = "the numbers never end")]
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `bound`, which is above 0.
    pub fn below(&mut self, bound: usize) -> usize {
        usize::try_from(self.next() >> 33).unwrap_or(0) % bound
    }

    /// A number from 0 to 1, without 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A number from -1 to 1, without 1.
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Whether something of this probability happens.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// One of `all`, of which there is at least one.
    pub fn pick<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        &all[self.below(all.len())]
    }
}

/// What replaces a number in a text.
const NUMBERS: [&str; 12] = [
    "0",
    "-1",
    "1",
    "2",
    "65536",
    "4294967295",
    "18446744073709551616",
    "1e308",
    "-1e-308",
    "nan",
    "inf",
    "",
];

/// What replaces four bytes.
const WORDS: [u32; 7] = [0, 1, u32::MAX, 0x7fff_ffff, 0x7f80_0000, 0x7fc0_0000, 0x0001_0000];

/// A copy of a file with one to four faults.
pub fn damage(sound: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = sound.to_vec();
    for _ in 0..=random.below(4) {
        if bytes.is_empty() {
            break;
        }
        // Most of what is read with care stands at the beginning.
        let reach = if random.below(2) == 0 { bytes.len() } else { bytes.len().min(2000) };
        let at = random.below(reach);
        match random.below(8) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = u8::try_from(random.below(256)).unwrap_or(0),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..(at + 1 + random.below(64)).min(reach))),
            4 => {
                let piece = bytes[at..(at + 1 + random.below(64)).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
            5 => {
                let word = WORDS[random.below(WORDS.len())].to_le_bytes();
                bytes.iter_mut().skip(at & !3).zip(word).for_each(|(byte, new)| *byte = new);
            }
            _ => replace_number(&mut bytes, at, NUMBERS[random.below(NUMBERS.len())]),
        }
    }
    bytes
}

/// Replaces the next number of a text at or behind a place.
fn replace_number(bytes: &mut Vec<u8>, at: usize, by: &str) {
    let Some(start) = bytes.iter().skip(at).position(u8::is_ascii_digit).map(|k| k + at) else { return };
    let length = bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
    bytes.splice(start..start + length, by.bytes());
}

/// A file that still `breaks` something, cut as far as some tries make it.
pub fn smaller(
    mut bytes: Vec<u8>,
    random: &mut Random,
    tries: usize,
    breaks: impl Fn(&[u8]) -> bool,
) -> Vec<u8> {
    for k in 0..tries {
        if bytes.len() < 2 {
            break;
        }
        let longest = (bytes.len() >> (k * 8 / tries)).max(1);
        let start = random.below(bytes.len());
        let end = (start + 1 + random.below(longest)).min(bytes.len());
        let cut = [&bytes[..start], &bytes[end..]].concat();
        if breaks(&cut) {
            bytes = cut;
        }
    }
    bytes
}
