//! Writes manual pages and shell completions of both programs, from their command lines:
//! `cargo run --release -p sspc-tests --example command_pages -- DIR`.
//!
//! `DIR` gets the folders that systems look into under `/usr/local/share`: `man/man1`, `bash-completion/completions`,
//! `zsh/site-functions`, `fish/vendor_completions.d`.

use clap::{Command, CommandFactory};
use clap_complete::{Generator, Shell, generate};
use std::error::Error;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [folder] = arguments.as_slice() else { return Err("expected one argument, the folder to write to".into()) };
    for command in [sspc_train::cli::Cli::command(), sspc_infer::cli::Arguments::command()] {
        let manual = made(folder, "man/man1")?;
        clap_mangen::generate_to(command.clone().disable_help_subcommand(true), manual)?;
        complete(Shell::Bash, &command, &made(folder, "bash-completion/completions")?.join(command.get_name()))?;
        complete(
            Shell::Zsh,
            &command,
            &made(folder, "zsh/site-functions")?.join(Shell::Zsh.file_name(command.get_name())),
        )?;
        complete(
            Shell::Fish,
            &command,
            &made(folder, "fish/vendor_completions.d")?.join(Shell::Fish.file_name(command.get_name())),
        )?;
    }
    Ok(())
}

/// A folder inside another, made when absent.
fn made(folder: &Path, inside: &str) -> std::io::Result<PathBuf> {
    let path = folder.join(inside);
    std::fs::create_dir_all(&path)?;
    Ok(path)
}

fn complete(shell: Shell, command: &Command, path: &Path) -> std::io::Result<()> {
    let mut text = Vec::new();
    generate(shell, &mut command.clone(), command.get_name(), &mut text);
    std::fs::write(path, text)
}
