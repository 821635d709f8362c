//! Headers of sound files with further, changed or rearranged attributes: well formed, with the offsets of the blocks
//! mended, so that the header alone decides whether the file is taken. By number, as `damage.rs`.

use sspc_core::rng::Rng;

/// Names that the standard gives a type, names of ours, and others.
const NAMES: [&str; 40] = [
    "framesPerSecond",
    "timeCode",
    "keyCode",
    "owner",
    "capDate",
    "utcOffset",
    "expTime",
    "isoSpeed",
    "aperture",
    "focus",
    "longitude",
    "worldToCamera",
    "worldToNDC",
    "chromaticities",
    "whiteLuminance",
    "adoptedNeutral",
    "xDensity",
    "wrapmodes",
    "envmap",
    "multiView",
    "view",
    "name",
    "type",
    "version",
    "chunkCount",
    "tiles",
    "preview",
    "comments",
    "dwaCompressionLevel",
    "maxSamplesPerPixel",
    "displayWindow",
    "screenWindowCenter",
    "screenWindowWidth",
    "pixelAspectRatio",
    "lineOrder",
    "sspc.tool",
    "sspc.seed",
    "an attribute whose name is longer than thirty-one bytes",
    "ä ö",
    "x",
];
/// Types and the length of their values; 0 where any will do.
const TYPES: [(&str, usize); 26] = [
    ("string", 0),
    ("stringvector", 0),
    ("float", 4),
    ("floatvector", 0),
    ("double", 8),
    ("int", 4),
    ("v2i", 8),
    ("v2f", 8),
    ("v2d", 16),
    ("v3i", 12),
    ("v3f", 12),
    ("m33f", 36),
    ("m44f", 64),
    ("m44d", 128),
    ("box2i", 16),
    ("box2f", 16),
    ("rational", 8),
    ("timecode", 8),
    ("keycode", 28),
    ("chromaticities", 32),
    ("compression", 1),
    ("lineOrder", 1),
    ("envmap", 1),
    ("tiledesc", 9),
    ("preview", 0),
    ("a type of somebody's own, with a long name", 0),
];
const MOST_CHANGES: usize = 4;
const LONGEST_VALUE: usize = 80;

/// Name, type, value.
type Attribute = (Vec<u8>, Vec<u8>, Vec<u8>);

/// A copy of a sound file of one part with one to four changes to its header's attributes; `None` of other files.
pub fn changed(whole: &[u8], case: u64) -> Option<Vec<u8>> {
    const SEVERAL_PARTS: u8 = 0x10;
    const LONG_NAMES: u8 = 0x04;
    if whole[5] & SEVERAL_PARTS != 0 {
        return None;
    }
    let mut rng = Rng::new(case ^ (whole.len() as u64) << 32);
    let (mut attributes, end) = attributes(whole);
    for _ in 0..1 + rng.below(MOST_CHANGES) {
        change(&mut attributes, &mut rng);
    }
    let mut header = whole[..8].to_vec();
    let is_long = |text: &Vec<u8>| text.len() > 31;
    if attributes.iter().any(|(name, kind, _)| is_long(name) || is_long(kind)) && rng.below(8) > 0 {
        header[5] |= LONG_NAMES;
    }
    for (name, kind, value) in &attributes {
        header.extend([name.as_slice(), &[0], kind, &[0], &(value.len() as i32).to_le_bytes(), value].concat());
    }
    header.push(0);
    Some(moved(whole, end, header))
}

fn change(attributes: &mut Vec<Attribute>, rng: &mut Rng) {
    let at = rng.below(attributes.len());
    match rng.below(8) {
        0 => {
            let other = rng.below(attributes.len());
            attributes.swap(at, other);
        }
        1 => attributes.push(attributes[at].clone()),
        2 => attributes[at].1 = TYPES[rng.below(TYPES.len())].0.into(),
        3 => {
            let length = attributes[at].2.len();
            if length > 0 {
                attributes[at].2[rng.below(length)] = rng.below(256) as u8;
            }
        }
        _ => {
            let (kind, length) = TYPES[rng.below(TYPES.len())];
            let length = if length == 0 || rng.below(8) == 0 { rng.below(LONGEST_VALUE) } else { length };
            // Often zeros and small numbers, which more types can be.
            let bound = [2, 128, 256][rng.below(3)];
            let value = (0..length).map(|_| rng.below(bound) as u8).collect();
            attributes.insert(at, (NAMES[rng.below(NAMES.len())].into(), kind.into(), value));
        }
    }
}

/// The attributes of the first header, and where it ends.
fn attributes(whole: &[u8]) -> (Vec<Attribute>, usize) {
    let (mut at, mut all) = (8, Vec::new());
    let text = |at: &mut usize| {
        let length = whole[*at..].iter().position(|&byte| byte == 0).expect("a text ends");
        let text = whole[*at..*at + length].to_vec();
        *at += length + 1;
        text
    };
    while whole[at] != 0 {
        let (name, kind) = (text(&mut at), text(&mut at));
        let length = i32::from_le_bytes(whole[at..at + 4].try_into().expect("four bytes")) as usize;
        all.push((name, kind, whole[at + 4..at + 4 + length].to_vec()));
        at += 4 + length;
    }
    (all, at + 1)
}

/// The file with another header: a table of offsets to the blocks follows it, up to the first of them.
fn moved(whole: &[u8], end: usize, header: Vec<u8>) -> Vec<u8> {
    let offset = |at: usize| u64::from_le_bytes(whole[at..at + 8].try_into().expect("eight bytes"));
    let mut first = whole.len() as u64;
    let mut table = Vec::new();
    let mut at = end;
    while (at as u64) < first {
        first = first.min(offset(at));
        table.push(offset(at) + header.len() as u64 - end as u64);
        at += 8;
    }
    let table: Vec<u8> = table.into_iter().flat_map(u64::to_le_bytes).collect();
    [header, table, whole[at..].to_vec()].concat()
}
