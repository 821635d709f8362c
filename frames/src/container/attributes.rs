//! Headers as they lie in a file: attributes by name, type and bytes, in their order.
//!
//! Nothing is decoded here, so that whatever a pipeline stamped into a header, under whatever name and type, is written
//! again as it was read.

use super::fault::Fault;
use std::io::{BufRead, Read};

/// Four bytes that mark the format.
pub const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// The version of the format that is read and written.
pub const VERSION: u32 = 2;
/// The first version with flags that are not ours.
const KNOWN_FLAGS: u32 = VERSION | TILED | LONG_NAMES | DEEP | MULTI_PART;
/// A single part of tiles.
pub const TILED: u32 = 1 << 9;
/// Names may be longer than [`SHORT_NAME`].
pub const LONG_NAMES: u32 = 1 << 10;
/// A part holds deep data.
pub const DEEP: u32 = 1 << 11;
/// Several parts, or one in the form of several.
pub const MULTI_PART: u32 = 1 << 12;
/// Longest name without [`LONG_NAMES`], in bytes.
pub const SHORT_NAME: usize = 31;
/// Longest name, in bytes.
pub const LONGEST_NAME: usize = 255;
/// Most bytes of all headers together: some megabytes of metadata were seen.
const MOST_BYTES: u64 = 1 << 28;
/// Most parts; production files have some hundreds.
const MOST_PARTS: usize = 4_096;

/// One attribute as in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attribute {
    pub name: Vec<u8>,
    /// Name of its type.
    pub kind: Vec<u8>,
    pub value: Vec<u8>,
}

/// The attributes of one part, in the file's order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Header {
    pub attributes: Vec<Attribute>,
}

impl Header {
    /// The value of the attribute of this name, if it has this type. What has the name and another type is none of the
    /// format's business.
    pub fn get(&self, name: &str, kind: &str) -> Option<&[u8]> {
        let found = self.attributes.iter().find(|a| a.name == name.as_bytes() && a.kind == kind.as_bytes());
        found.map(|attribute| attribute.value.as_slice())
    }

    /// Gives the attribute of this name another value, in its place: the one of this type, else the first of the name,
    /// which takes the type as well. New ones come last.
    pub fn set(&mut self, name: &str, kind: &str, value: Vec<u8>) {
        let (name, kind) = (name.as_bytes().to_vec(), kind.as_bytes().to_vec());
        let same = |attribute: &Attribute| attribute.name == name && attribute.kind == kind;
        let at = self.attributes.iter().position(same);
        match at.or_else(|| self.attributes.iter().position(|attribute| attribute.name == name)) {
            Some(at) => self.attributes[at] = Attribute { name, kind, value },
            None => self.attributes.push(Attribute { name, kind, value }),
        }
    }

    /// Takes out the attribute of this name and type.
    pub fn remove(&mut self, name: &str, kind: &str) {
        self.attributes.retain(|a| a.name != name.as_bytes() || a.kind != kind.as_bytes());
    }
}

/// Everything before the tables of chunks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Preamble {
    /// Version and flags.
    pub version: u32,
    pub headers: Vec<Header>,
}

impl Preamble {
    /// Reads all headers of a file of `length` bytes; the magic number too.
    ///
    /// # Errors
    /// [`Fault`]: another version, headers that end too soon or are longer than the file.
    pub fn read(input: &mut impl BufRead, length: u64) -> Result<Self, Fault> {
        let mut input = Bounded { input, left: length.min(MOST_BYTES) };
        let [a, b, c, d] = input.array()?;
        if [a, b, c, d] != MAGIC {
            return Err(Fault::damaged("no OpenEXR file"));
        }
        let version = u32::from_le_bytes(input.array()?);
        check_version(version)?;
        let mut headers = Vec::new();
        loop {
            let header = read_header(&mut input)?;
            if header.attributes.is_empty() {
                // Several headers end with an empty one.
                break;
            }
            headers.push(header);
            if headers.len() > MOST_PARTS {
                let expected = format!("at most {MOST_PARTS} parts");
                return Err(Fault::TooLarge { expected, found: "more".into() });
            }
            if version & MULTI_PART == 0 {
                break;
            }
        }
        match headers.is_empty() {
            true => Err(Fault::damaged("a header without attributes")),
            false => Ok(Self { version, headers }),
        }
    }

    /// Whether the file has the form of several parts.
    pub fn is_multi_part(&self) -> bool {
        self.version & MULTI_PART != 0
    }

    /// The bytes of a file up to its tables. The flag of long names is set where a name needs it.
    pub fn to_bytes(&self) -> Vec<u8> {
        let attributes = || self.headers.iter().flat_map(|header| &header.attributes);
        let is_long = |name: &[u8]| name.len() > SHORT_NAME;
        let long = attributes().any(|attribute| is_long(&attribute.name) || is_long(&attribute.kind));
        let version = if long { self.version | LONG_NAMES } else { self.version };
        let mut bytes = [MAGIC, version.to_le_bytes()].concat();
        for header in &self.headers {
            for Attribute { name, kind, value } in &header.attributes {
                for text in [name, kind] {
                    bytes.extend_from_slice(text);
                    bytes.push(0);
                }
                bytes.extend_from_slice(&(value.len() as u32).to_le_bytes());
                bytes.extend_from_slice(value);
            }
            bytes.push(0);
        }
        if self.is_multi_part() {
            bytes.push(0);
        }
        bytes
    }
}

fn check_version(version: u32) -> Result<(), Fault> {
    let unsupported = |found: String| Err(Fault::Unsupported { expected: "OpenEXR version 2", found });
    if version & 0xff != VERSION {
        return unsupported(format!("version {}", version & 0xff));
    }
    if version & !KNOWN_FLAGS != 0 {
        return unsupported(format!("unknown flags {:#x}", version & !KNOWN_FLAGS));
    }
    match (version & TILED != 0, version & (DEEP | MULTI_PART) != 0) {
        (true, true) => Err(Fault::damaged(format!("flags {version:#x} that exclude each other"))),
        _ => Ok(()),
    }
}

/// A reader that gives no more than it may.
struct Bounded<'a, R> {
    input: &'a mut R,
    left: u64,
}

impl<R: BufRead> Bounded<'_, R> {
    fn spend(&mut self, bytes: u64) -> Result<(), Fault> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| Fault::damaged("headers longer than the file"))?;
        Ok(())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        self.spend(N as u64)?;
        let mut bytes = [0; N];
        self.input.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn bytes(&mut self, length: usize) -> Result<Vec<u8>, Fault> {
        self.spend(length as u64)?;
        let mut bytes = vec![0; length];
        self.input.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    /// A text up to its null.
    fn text(&mut self) -> Result<Vec<u8>, Fault> {
        let mut text = Vec::new();
        self.input.by_ref().take(LONGEST_NAME as u64 + 1).read_until(0, &mut text)?;
        self.spend(text.len() as u64)?;
        match text.pop() {
            Some(0) => Ok(text),
            _ => Err(Fault::damaged(format!("a name of more than {LONGEST_NAME} bytes, or its end inside a header"))),
        }
    }
}

fn read_header<R: BufRead>(input: &mut Bounded<R>) -> Result<Header, Fault> {
    let mut header = Header::default();
    loop {
        let name = input.text()?;
        if name.is_empty() {
            return Ok(header);
        }
        let kind = input.text()?;
        if kind.is_empty() {
            // Other readers take it for the header's end.
            return Err(Fault::damaged(format!("an attribute {} without a type", String::from_utf8_lossy(&name))));
        }
        let length = i32::from_le_bytes(input.array()?);
        let length = usize::try_from(length).map_err(|_| Fault::damaged("an attribute of negative length"))?;
        let value = input.bytes(length)?;
        header.attributes.push(Attribute { name, kind, value });
    }
}
