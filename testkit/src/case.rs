//! Reads the parity cases that the PyTorch reference made (`tests/cases`): `io.npz` and `case.json`. A case that is not
//! what its reader asks for is an error that says so, never a test that silently compares less.

use npyz::npz::NpzArchive;
use serde_json::Value;
use sspc_image::Image;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where the committed cases are.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/cases")
}

/// One array of a case; float32 and int32 arrays are widened without loss.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    pub shape: Vec<usize>,
    pub values: Vec<f64>,
}

impl Array {
    /// Values as they lie in planes `[C, H, W]`.
    pub fn of_image(image: &Image) -> Self {
        let shape = vec![image.channels(), image.height(), image.width()];
        Self { shape, values: image.data().iter().map(|&v| f64::from(v)).collect() }
    }

    /// Values of one axis.
    pub fn flat(values: &[f32]) -> Self {
        Self { shape: vec![values.len()], values: values.iter().map(|&v| f64::from(v)).collect() }
    }

    /// Values of three axes, or entry `index` of four, as planes `[C, H, W]`.
    ///
    /// # Panics
    /// When there are other axes.
    pub fn image(&self, index: usize) -> Image {
        let &[.., channels, height, width] = &self.shape[..] else { panic!("planes of shape {:?}", self.shape) };
        let size = channels * height * width;
        Image::from_planes(channels, height, width, self.f32()[index * size..][..size].to_vec())
    }

    /// The values as f32: exact for inputs, rounded once for results.
    pub fn f32(&self) -> Vec<f32> {
        self.values.iter().map(|&v| v as f32).collect()
    }

    /// Values `[first * inner .. last * inner]` along the first axis.
    pub fn slab(&self, first: usize, last: usize) -> Array {
        let inner = self.values.len() / self.shape[0];
        let mut shape = self.shape.clone();
        shape[0] = last - first;
        Array { shape, values: self.values[first * inner..last * inner].to_vec() }
    }
}

/// Why a case cannot be compared with.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    #[error("{}: {problem}", path.display())]
    Unreadable { path: PathBuf, problem: String },
    #[error("case {case}: no array {key}; it has {found}")]
    MissingArray { case: String, key: String, found: String },
    #[error("case {case}: {key} expected shape {expected:?}, found {found:?}")]
    Shape { case: String, key: String, expected: Vec<usize>, found: Vec<usize> },
    #[error("case {case}: {key} has {count} values that are not finite, the first at index {first}")]
    NotFinite { case: String, key: String, count: usize, first: usize },
    #[error("case {case}: case.json has no {key} of the expected type")]
    Fact { case: String, key: String },
}

/// A case as read.
#[derive(Debug)]
pub struct Case {
    pub name: String,
    pub facts: Value,
    pub arrays: BTreeMap<String, Array>,
}

impl Case {
    /// The committed case `name`.
    pub fn load(name: &str) -> Result<Self, CaseError> {
        Self::read(&root().join(name))
    }

    /// The case in `folder`.
    pub fn read(folder: &Path) -> Result<Self, CaseError> {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let unreadable = |file: &str, problem: String| CaseError::Unreadable { path: folder.join(file), problem };
        let facts = std::fs::read(folder.join("case.json")).map_err(|e| unreadable("case.json", e.to_string()))?;
        let facts = serde_json::from_slice(&facts).map_err(|e| unreadable("case.json", e.to_string()))?;
        let arrays = read_npz(&folder.join("io.npz")).map_err(|e| unreadable("io.npz", e.to_string()))?;
        Ok(Self { name, facts, arrays })
    }

    /// The committed case `name`, for tests: the error is the panic's text.
    pub fn named(name: &str) -> Self {
        Self::load(name).unwrap_or_else(|error| panic!("{error}"))
    }

    /// All committed cases of one kind.
    pub fn of_kind(kind: &str) -> Vec<Case> {
        let folders = std::fs::read_dir(root()).expect("tests/cases");
        let mut paths: Vec<PathBuf> = folders.map(|f| f.expect("tests/cases").path()).filter(|p| p.is_dir()).collect();
        paths.sort();
        let cases = paths.iter().map(|path| Case::read(path).unwrap_or_else(|error| panic!("{error}")));
        let found: Vec<Case> = cases.filter(|case| case.facts["kind"] == kind).collect();
        assert!(!found.is_empty(), "no committed case of kind {kind}");
        found
    }

    /// Array `key`, finite and of `shape`.
    pub fn array(&self, key: &str, shape: &[usize]) -> Result<&Array, CaseError> {
        let case = || self.name.clone();
        let array = self.arrays.get(key).ok_or_else(|| CaseError::MissingArray {
            case: case(),
            key: key.into(),
            found: self.arrays.keys().cloned().collect::<Vec<_>>().join(", "),
        })?;
        if array.shape != shape {
            let (expected, found) = (shape.to_vec(), array.shape.clone());
            return Err(CaseError::Shape { case: case(), key: key.into(), expected, found });
        }
        if let Some(first) = array.values.iter().position(|v| !v.is_finite()) {
            let count = array.values.iter().filter(|v| !v.is_finite()).count();
            return Err(CaseError::NotFinite { case: case(), key: key.into(), count, first });
        }
        Ok(array)
    }

    /// As [`Self::array`], for tests: the error is the panic's text.
    pub fn get(&self, key: &str, shape: &[usize]) -> &Array {
        self.array(key, shape).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Array `key` of whatever shape, finite, for tests.
    pub fn any(&self, key: &str) -> &Array {
        let shape = self.arrays.get(key).map(|array| array.shape.clone()).unwrap_or_default();
        self.get(key, &shape)
    }

    /// Height and width of array `key`.
    pub fn size(&self, key: &str) -> (usize, usize) {
        match self.arrays.get(key).map(|a| a.shape.as_slice()) {
            Some(&[.., height, width]) => (height, width),
            _ => panic!("case {}: {key} has no height and width", self.name),
        }
    }

    /// A whole number of case.json.
    pub fn count(&self, key: &str) -> usize {
        let fact = self.facts[key].as_u64().ok_or_else(|| CaseError::Fact { case: self.name.clone(), key: key.into() });
        fact.unwrap_or_else(|error| panic!("{error}")) as usize
    }
}

fn read_npz(path: &Path) -> std::io::Result<BTreeMap<String, Array>> {
    let mut archive = NpzArchive::open(path)?;
    let names: Vec<String> = archive.array_names().map(String::from).collect();
    let mut arrays = BTreeMap::new();
    for name in names {
        let file = archive.by_name(&name)?.ok_or(std::io::ErrorKind::NotFound)?;
        let shape = file.shape().iter().map(|&n| n as usize).collect();
        let invalid =
            |problem: &str| std::io::Error::new(std::io::ErrorKind::InvalidData, format!("{name}: {problem}"));
        if file.order() != npyz::Order::C {
            return Err(invalid("not in C order"));
        }
        let values = match file.dtype().descr().trim_matches('\'') {
            "<f8" => file.into_vec::<f64>()?,
            "<f4" => file.into_vec::<f32>()?.into_iter().map(f64::from).collect(),
            "<i4" => file.into_vec::<i32>()?.into_iter().map(f64::from).collect(),
            other => return Err(invalid(&format!("expected f8, f4 or i4, found {other}"))),
        };
        arrays.insert(name, Array { shape, values });
    }
    Ok(arrays)
}
