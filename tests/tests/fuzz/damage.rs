//! Damage by number: the same number gives the same bytes on every machine.

use sspc_core::rng::Rng;

/// What the seeds are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alphabet {
    Bytes,
    Text,
}

/// Numbers at which arithmetic goes wrong, as 4-byte little-endian integers.
const EXTREMES: [i32; 12] =
    [i32::MAX, i32::MIN, -1, 0, 1, 1_000_000_000, 1 << 16, 1 << 20, 1 << 24, (1 << 24) - 1, 65_535, i32::MAX - 1];
/// The same for protobuf's variable-length integers: 2^64 - 1, 2^63, 2^32, 2^31 - 1, an endless one.
const VARINTS: [&[u8]; 5] = [
    &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01],
    &[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x01],
    &[0x80, 0x80, 0x80, 0x80, 0x10],
    &[0xff, 0xff, 0xff, 0xff, 0x07],
    &[0xff; 11],
];
/// What arguments are made of, and what they must not be made of.
const WORDS: [&str; 30] = [
    "#",
    "##",
    "%d",
    "%04d",
    "%",
    "d",
    "-",
    ",",
    "x",
    "0",
    "1",
    "9",
    "999999999",
    "1000000000",
    "4294967295",
    "4294967296",
    "18446744073709551616",
    "=",
    ":",
    ".exr",
    "none",
    "albedo",
    "-full",
    "-a",
    " ",
    "\n",
    "\u{1b}[2J",
    "\u{0}",
    "ä",
    "\u{1F600}",
];
/// Most injuries of one copy.
const MOST_INJURIES: usize = 5;
/// Header fields lie here; half of the injuries go there.
const HEADER: usize = 600;
/// Longest piece that is copied, cut or overwritten.
const PIECE: usize = 64;
/// Copies stay below this, however often pieces are doubled.
const LONGEST: usize = 1 << 16;

/// A copy of `whole` with one to five injuries; pieces may come from any seed.
pub fn damaged(whole: &[u8], seeds: &[(String, Vec<u8>)], case: u64, alphabet: Alphabet) -> Vec<u8> {
    let mut rng = Rng::new(case ^ (whole.len() as u64) << 32);
    let mut bytes = whole.to_vec();
    for _ in 0..1 + rng.below(MOST_INJURIES) {
        match alphabet {
            Alphabet::Bytes => injure(&mut bytes, seeds, &mut rng),
            Alphabet::Text => misspell(&mut bytes, seeds, &mut rng),
        }
        bytes.truncate(LONGEST);
    }
    bytes
}

fn place(bytes: &[u8], rng: &mut Rng) -> usize {
    let bound = if rng.below(2) == 0 { HEADER } else { usize::MAX };
    rng.below((bytes.len() + 1).min(bound))
}

fn injure(bytes: &mut Vec<u8>, seeds: &[(String, Vec<u8>)], rng: &mut Rng) {
    let at = place(bytes, rng);
    let end = (at + 1 + rng.below(PIECE)).min(bytes.len());
    match rng.below(10) {
        0 => bytes.truncate(at),
        1 | 2 if at < bytes.len() => bytes[at] ^= 1 << rng.below(8),
        3 if at < bytes.len() => bytes[at] = rng.below(256) as u8,
        4 => overwrite(bytes, at, &EXTREMES[rng.below(EXTREMES.len())].to_le_bytes()),
        5 => overwrite(bytes, at, VARINTS[rng.below(VARINTS.len())]),
        6 => {
            let piece = bytes[at..end].to_vec();
            let to = place(bytes, rng);
            bytes.splice(to..to, piece);
        }
        7 => drop(bytes.drain(at..end)),
        8 => bytes[at..end].fill([0, 0xff, b'9'][rng.below(3)]),
        _ => splice_other(bytes, at, seeds, rng),
    }
}

fn overwrite(bytes: &mut [u8], at: usize, with: &[u8]) {
    let end = (at + with.len()).min(bytes.len());
    bytes[at..end].copy_from_slice(&with[..end - at]);
}

/// The rest from another seed's place of the same number.
fn splice_other(bytes: &mut Vec<u8>, at: usize, seeds: &[(String, Vec<u8>)], rng: &mut Rng) {
    let other = &seeds[rng.below(seeds.len())].1;
    bytes.truncate(at);
    bytes.extend_from_slice(other.get(at..).unwrap_or_default());
}

fn misspell(bytes: &mut Vec<u8>, seeds: &[(String, Vec<u8>)], rng: &mut Rng) {
    let at = place(bytes, rng);
    let end = (at + 1 + rng.below(4)).min(bytes.len());
    match rng.below(6) {
        0..=2 => drop(bytes.splice(at..at, WORDS[rng.below(WORDS.len())].bytes())),
        3 => drop(bytes.drain(at..end)),
        4 => {
            let piece = bytes[at..end].to_vec();
            bytes.splice(at..at, piece);
        }
        _ => splice_other(bytes, at, seeds, rng),
    }
}
