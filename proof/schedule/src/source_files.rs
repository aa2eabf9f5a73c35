//! The source files of a project.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// A file that is compiled.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceFile {
    /// Its path from the root of the project.
    pub name: String,
    /// Its text.
    pub text: String,
}

impl SourceFile {
    /// Reads the Rust files of the folder `src` in `root`, in order.
    ///
    /// # Errors
    ///
    /// Tells which file or folder cannot be read.
    pub fn all(root: &Path) -> Result<Vec<Self>, String> {
        let mut paths = Vec::new();
        list(&root.join("src"), &mut paths)
            .map_err(|error| format!("{}/src: {error}", root.display()))?;
        let files = paths.into_iter().map(|path| {
            let name = path.strip_prefix(root).unwrap_or(&path);
            let name = name.to_string_lossy().into_owned();
            match fs::read_to_string(&path) {
                Ok(text) => Ok(Self { name, text }),
                Err(error) => Err(format!("{name}: {error}")),
            }
        });
        files.collect()
    }
}

/// All Rust files below `folder`, in order.
fn list(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<io::Result<_>>()?;
    entries.sort();
    for path in entries {
        if path.is_dir() {
            list(&path, found)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_the_firmware_are_found_by_their_names() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let files = SourceFile::all(&root).unwrap();
        let app = files.iter().find(|file| file.name == "src/app.rs").unwrap();
        assert!(app.text.contains("rtic::app"));
        assert!(files.iter().any(|file| file.name.starts_with("src/board/")));
        let error = SourceFile::all(Path::new("/none")).unwrap_err();
        assert!(error.starts_with("/none/src: "), "{error}");
    }
}
