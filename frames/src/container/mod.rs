//! An OpenEXR file by its bytes: headers as they are, tables, chunks.
//!
//! The `exr` crate compresses and decompresses blocks; it never sees a header from a file, because it decodes and writes
//! again what it knows, and refuses what has a known name and another type. See [`attributes`].

pub mod attributes;
pub mod channels;
pub mod chunks;
pub mod copy;
pub mod fault;
mod limits;
pub mod part;
pub mod pixels;
mod zip;

use attributes::{MULTI_PART, Preamble};
use chunks::ChunkReader;
use fault::Fault;
use part::Part;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Headers and tables of a file.
#[derive(Clone, Debug)]
pub struct Container {
    pub path: PathBuf,
    /// Version and flags.
    pub version: u32,
    pub parts: Vec<Part>,
    /// Offset of every chunk, part by part: increasing rows; tiles row by row, level by level.
    pub tables: Arc<Vec<Vec<u64>>>,
    /// Offset of the first byte after the tables.
    first_chunk: u64,
    /// Bytes of the file.
    length: u64,
}

impl Container {
    /// Reads headers and tables of a file, no pixels.
    ///
    /// # Errors
    /// [`Fault`].
    pub fn open(path: &Path) -> Result<Self, Fault> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        let mut input = BufReader::new(file);
        let Preamble { version, headers } = Preamble::read(&mut input, length)?;
        let parts = headers.into_iter().map(|header| Part::of(header, version)).collect::<Result<Vec<_>, _>>()?;
        limits::check_claims(&parts, length)?;
        if let (true, Some(fault)) = (parts.iter().all(|part| part.undecodable().is_some()), parts[0].undecodable()) {
            return Err(fault);
        }
        let mut tables = Vec::new();
        for part in &parts {
            let mut bytes = vec![0; 8 * part.chunks];
            input.read_exact(&mut bytes)?;
            let offset = |bytes: &[u8]| bytes.iter().rev().fold(0, |offset, &byte| offset << 8 | u64::from(byte));
            tables.push(bytes.chunks_exact(8).map(offset).collect());
        }
        let first_chunk = input.stream_position()?;
        let is_written = |table: &Vec<u64>| table.iter().all(|offset| (first_chunk..length).contains(offset));
        let are_written = tables.iter().all(is_written);
        let mut container = Self { path: path.into(), version, parts, tables: Arc::new(tables), first_chunk, length };
        if !are_written {
            container.tables = Arc::new(ChunkReader::open(&container)?.scan()?);
        }
        Ok(container)
    }

    /// Whether the file has the form of several parts.
    pub fn is_multi_part(&self) -> bool {
        self.version & MULTI_PART != 0
    }
}
