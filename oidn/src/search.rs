//! Where the library may lie: the user's word first, then the system's loader, then the places that Python packages,
//! Blender and distributions put it. Folders are listed, and nothing is run.

use crate::error::OidnError;
use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Something that may be the library.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Candidate {
    /// A name that the system's loader looks for on its own path.
    Loader(&'static str),
    /// A file.
    File(PathBuf),
}

/// Everything outside the program that decides where the library is looked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Surroundings {
    /// What the user named (`--oidn`): the library, its folder, or the folder above.
    pub named: Option<PathBuf>,
    /// `OIDN_DIR`: the same.
    pub oidn_dir: Option<PathBuf>,
    /// `VIRTUAL_ENV`: an active environment of Python.
    pub virtual_env: Option<PathBuf>,
    /// `CONDA_PREFIX`: an active environment of conda.
    pub conda_prefix: Option<PathBuf>,
    /// `PATH`, where Python and Blender may lie.
    pub path: Vec<PathBuf>,
    /// The user's own folder.
    pub home: Option<PathBuf>,
    /// Folders of programs: `/opt` and the like, `ProgramFiles`.
    pub programs: Vec<PathBuf>,
}

/// Names by which the system's loader knows version 2, the most definite first.
const LOADER_NAMES: &[&str] = if cfg!(windows) {
    &["OpenImageDenoise.dll"]
} else if cfg!(target_os = "macos") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
} else {
    &["libOpenImageDenoise.so.2", "libOpenImageDenoise.so"]
};

/// Folders under an installation, or under the package of pyoidn, that may hold the library.
const LIBRARY_FOLDERS: &[&str] = &["", "lib", "lib64", "bin", "oidn/lib", "oidn/bin"];

/// Folders under site-packages that hold it: of PyPI's pyoidn, and of Blender as a module.
const IN_SITE_PACKAGES: &[&str] = &["pyoidn/oidn/lib", "pyoidn/oidn/bin", "bpy/lib", "bpy"];

impl Surroundings {
    /// Those of this process, and what the user named.
    pub fn of_process(named: Option<&Path>) -> Self {
        let folder = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let programs = match cfg!(windows) {
            true => ["ProgramFiles", "ProgramW6432"].into_iter().filter_map(folder).collect(),
            false => ["/opt", "/Applications", "/usr/local", "/opt/homebrew", "/opt/local"].map(PathBuf::from).to_vec(),
        };
        Self {
            named: named.map(Path::to_path_buf),
            oidn_dir: folder("OIDN_DIR"),
            virtual_env: folder("VIRTUAL_ENV"),
            conda_prefix: folder("CONDA_PREFIX"),
            path: env::var_os("PATH").map(|path| env::split_paths(&path).collect()).unwrap_or_default(),
            home: folder(if cfg!(windows) { "USERPROFILE" } else { "HOME" }),
            programs,
        }
    }

    /// What may be the library, the best first. What the user named, or `OIDN_DIR` names, is the only one.
    ///
    /// # Errors
    /// [`OidnError::NotThere`] when what was named holds none.
    pub fn candidates(&self) -> Result<Vec<Candidate>, OidnError> {
        for (named, path) in [("--oidn", &self.named), ("OIDN_DIR", &self.oidn_dir)] {
            if let Some(path) = path {
                let files = named_files(path);
                return match files.is_empty() {
                    true => Err(OidnError::NotThere { named, path: path.clone() }),
                    false => Ok(files.into_iter().map(Candidate::File).collect()),
                };
            }
        }
        let folders = [self.python_folders(), self.blender_folders(), self.distribution_folders()].concat();
        let mut files: Vec<PathBuf> = Vec::new();
        for file in folders.iter().flat_map(|folder| libraries_in(folder)) {
            if !files.contains(&file) {
                files.push(file);
            }
        }
        let loader = LOADER_NAMES.iter().map(|name| Candidate::Loader(name));
        Ok(loader.chain(files.into_iter().map(Candidate::File)).collect())
    }

    /// Packages of an active environment, of the Pythons on the path, and the user's own.
    fn python_folders(&self) -> Vec<PathBuf> {
        let pythons = self.path.iter().filter(|folder| has_program(folder, &["python3", "python"]));
        // bin and Scripts lie in the environment; Windows keeps python.exe at its root as well.
        let of_path =
            pythons.flat_map(|folder| [folder.parent().map(Path::to_path_buf), Some(folder.clone())]).flatten();
        let own = self.home.iter().map(|home| home.join(".local"));
        let prefixes = self.virtual_env.iter().chain(&self.conda_prefix).cloned().chain(of_path).chain(own);
        prefixes.flat_map(|prefix| folders_of_python(&prefix)).collect()
    }

    /// Beside Blender, wherever its program is.
    fn blender_folders(&self) -> Vec<PathBuf> {
        let on_path = self.path.iter().filter(|folder| has_program(folder, &["blender"]));
        let real = on_path.filter_map(|folder| folder.join("blender").canonicalize().ok());
        let mut homes: Vec<PathBuf> = real.filter_map(|program| program.parent().map(Path::to_path_buf)).collect();
        let under = self.programs.iter().chain(&self.home).cloned();
        let with_applications = self.home.iter().map(|home| home.join("Applications"));
        for folder in under.chain(with_applications) {
            homes.extend(beginning_with(&folder, "blender"));
            homes.extend(beginning_with(&folder.join("Blender Foundation"), "blender"));
        }
        homes.push("/snap/blender/current".into());
        homes.push("/var/lib/flatpak/app/org.blender.Blender/current/active/files/blender".into());
        homes.extend(self.home.iter().map(|home| home.join(".steam/steam/steamapps/common/Blender")));
        let within = ["lib", "blender.shared", "Contents/Resources/lib", ""];
        homes.iter().flat_map(|home| within.map(|folder| home.join(folder))).collect()
    }

    /// Where package managers put libraries, some of them outside the loader's path; OIDN's own archives unpacked.
    fn distribution_folders(&self) -> Vec<PathBuf> {
        let conda = self.conda_prefix.iter().map(|prefix| prefix.join("Library"));
        let unpacked = self.programs.iter().chain(&self.home).flat_map(|folder| beginning_with(folder, "oidn"));
        let roots = self.conda_prefix.iter().cloned().chain(conda).chain(unpacked).chain(self.programs.iter().cloned());
        roots.flat_map(|root| ["lib", "lib64", "bin"].map(|folder| root.join(folder))).collect()
    }
}

/// Folders under an environment of Python (the folder that holds `bin` or `Scripts`) that may hold the library.
pub fn folders_of_python(prefix: &Path) -> Vec<PathBuf> {
    let mut packages = vec![prefix.join("Lib/site-packages")];
    for lib in ["lib", "lib64", "local/lib"] {
        let versions = beginning_with(&prefix.join(lib), "python3");
        packages.extend(
            versions.into_iter().flat_map(|version| ["site-packages", "dist-packages"].map(|name| version.join(name))),
        );
    }
    packages.iter().flat_map(|folder| IN_SITE_PACKAGES.iter().map(|within| folder.join(within))).collect()
}

/// The libraries in a folder, higher versions first.
pub fn libraries_in(folder: &Path) -> Vec<PathBuf> {
    let mut names: Vec<_> = names_in(folder).into_iter().filter(|name| is_library(&name.to_string_lossy())).collect();
    names.sort_unstable_by(|a, b| b.cmp(a));
    let mut real: Vec<PathBuf> = Vec::new();
    let mut files = Vec::new();
    for file in names.into_iter().map(|name| folder.join(name)) {
        // Versions of one library are links to each other.
        let target = file.canonicalize().unwrap_or_else(|_| file.clone());
        if !real.contains(&target) {
            real.push(target);
            files.push(file);
        }
    }
    files
}

/// The libraries of a path that was named: itself, those in it, or in a folder of it.
fn named_files(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_path_buf()];
    }
    LIBRARY_FOLDERS.iter().flat_map(|folder| libraries_in(&path.join(folder))).collect()
}

/// Whether a file's name is the library's on this system: `libOpenImageDenoise.so.2.3.0`, but not
/// `libOpenImageDenoise_core.so.2.3.0`.
fn is_library(name: &str) -> bool {
    let name = name.to_lowercase();
    if cfg!(windows) {
        name == "openimagedenoise.dll"
    } else if cfg!(target_os = "macos") {
        name.starts_with("libopenimagedenoise.") && name.ends_with(".dylib")
    } else {
        name == "libopenimagedenoise.so" || name.starts_with("libopenimagedenoise.so.")
    }
}

fn has_program(folder: &Path, names: &[&str]) -> bool {
    names.iter().any(|name| folder.join(name).is_file() || folder.join(name).with_extension("exe").is_file())
}

/// Folders in `folder` whose names begin so, whatever their case, the last (newest version) first.
fn beginning_with(folder: &Path, beginning: &str) -> Vec<PathBuf> {
    let begins = |name: &OsStr| name.to_string_lossy().to_lowercase().starts_with(beginning);
    let mut names: Vec<_> = names_in(folder).into_iter().filter(|name| begins(name)).collect();
    names.sort_unstable_by(|a, b| b.cmp(a));
    names.into_iter().map(|name| folder.join(name)).filter(|path| path.is_dir()).collect()
}

/// Names in a folder; none where there is no such folder.
fn names_in(folder: &Path) -> Vec<std::ffi::OsString> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    entries.filter_map(|entry| entry.ok().map(|entry| entry.file_name())).collect()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    fn file(root: &Path, path: &str) -> PathBuf {
        let path = root.join(path);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(&path, "").expect("a file");
        path
    }

    fn files(surroundings: &Surroundings) -> Vec<PathBuf> {
        let of_file = |candidate| match candidate {
            Candidate::File(path) => Some(path),
            Candidate::Loader(_) => None,
        };
        surroundings.candidates().expect("candidates").into_iter().filter_map(of_file).collect()
    }

    #[test]
    fn what_was_named_comes_alone_as_file_folder_or_root() {
        let root = tempfile::tempdir().expect("a folder");
        let library = file(root.path(), "named/lib/libOpenImageDenoise.so.2.3.0");
        file(root.path(), "named/lib/libOpenImageDenoise_core.so.2.3.0");
        let other = file(root.path(), "other/libOpenImageDenoise.so");
        for named in ["named", "named/lib", "named/lib/libOpenImageDenoise.so.2.3.0"] {
            let oidn_dir = Some(root.path().join("other"));
            let named = Some(root.path().join(named));
            let surroundings = Surroundings { named, oidn_dir, ..Surroundings::default() };
            assert_eq!(surroundings.candidates(), Ok(vec![Candidate::File(library.clone())]));
        }
        let of_package = file(root.path(), "pyoidn/oidn/lib/libOpenImageDenoise.so.2");
        for (folder, library) in [("other", other), ("pyoidn", of_package)] {
            let oidn_dir = Some(root.path().join(folder));
            let surroundings = Surroundings { oidn_dir, home: Some(root.path().into()), ..Surroundings::default() };
            assert_eq!(surroundings.candidates(), Ok(vec![Candidate::File(library)]));
        }
    }

    #[test]
    fn what_was_named_and_is_not_there_is_an_error_that_says_who_named_it() {
        let root = tempfile::tempdir().expect("a folder");
        let path = root.path().join("nowhere");
        let surroundings = Surroundings { oidn_dir: Some(path.clone()), ..Surroundings::default() };
        assert_eq!(surroundings.candidates(), Err(OidnError::NotThere { named: "OIDN_DIR", path: path.clone() }));
        let surroundings = Surroundings { named: Some(path.clone()), ..surroundings };
        assert_eq!(surroundings.candidates(), Err(OidnError::NotThere { named: "--oidn", path }));
    }

    #[test]
    fn the_loader_comes_first_then_python_blender_and_distributions() {
        let root = tempfile::tempdir().expect("a folder");
        let at = |path: &str| file(root.path(), path);
        let in_environment = at("venv/lib/python3.12/site-packages/pyoidn/oidn/lib/libOpenImageDenoise.so.2");
        at("usr/bin/python3");
        let in_python = at("usr/lib/python3.11/site-packages/pyoidn/oidn/lib/libOpenImageDenoise.so.2");
        let in_blender = at("opt/blender-4.2/lib/libOpenImageDenoise.so.2");
        let newer_blender = at("opt/blender-5.0/lib/libOpenImageDenoise.so.2");
        let unpacked = at("home/oidn-2.3.0.x86_64.linux/lib/libOpenImageDenoise.so.2.3.0");
        let surroundings = Surroundings {
            virtual_env: Some(root.path().join("venv")),
            path: vec![root.path().join("usr/bin")],
            home: Some(root.path().join("home")),
            programs: vec![root.path().join("opt")],
            ..Surroundings::default()
        };
        let candidates = surroundings.candidates().expect("candidates");
        let loader = LOADER_NAMES.iter().map(|name| Candidate::Loader(name)).collect::<Vec<_>>();
        assert_eq!(candidates[..loader.len()], loader);
        let found: Vec<PathBuf> =
            files(&surroundings).into_iter().filter(|file| file.starts_with(root.path())).collect();
        assert_eq!(found, [in_environment, in_python, newer_blender, in_blender, unpacked]);
    }

    #[test]
    fn links_to_one_library_are_one_candidate_and_higher_versions_come_first() {
        let root = tempfile::tempdir().expect("a folder");
        let new = file(root.path(), "libOpenImageDenoise.so.2.5.1");
        let old = file(root.path(), "libOpenImageDenoise.so.1.4.3");
        std::os::unix::fs::symlink(&new, root.path().join("libOpenImageDenoise.so")).expect("a link");
        std::os::unix::fs::symlink(&new, root.path().join("libOpenImageDenoise.so.2")).expect("a link");
        assert_eq!(libraries_in(root.path()), [new, old]);
    }
}
