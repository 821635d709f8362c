//! What can happen to a program from outside: it is killed, interrupted, nobody reads what it says, its disk is full,
//! its folder may not be written to.

use crate::skips::skipped;
use sspc_core::rng::Rng;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

/// When to stop a program.
#[derive(Clone, Copy, Debug)]
pub enum Moment {
    /// So long after its start.
    Start(Duration),
    /// So long after the sign that it has begun to write.
    Sign(Duration),
}

/// Moments at which to stop a program: half of them anywhere in its run, half while it writes.
pub struct Moments {
    whole: Duration,
    writing: Duration,
    rng: Rng,
    count: usize,
}

/// Runs differ in length: moments reach this far beyond the end of the one measured.
const BEYOND: f32 = 1.2;
/// Between two looks for the sign.
const LOOK: Duration = Duration::from_micros(100);

impl Moments {
    /// `count` moments of a run like `command`, which is run once to know how long that is; `sign` says whether it has
    /// begun to write.
    ///
    /// # Panics
    /// When the run fails or gives no sign.
    pub fn of(command: Command, count: usize, sign: impl Fn() -> bool) -> Self {
        let mut child = start(command);
        let begin = Instant::now();
        assert!(wait_for(&mut child, &sign) || sign(), "the run gives a sign when it writes");
        let seen = begin.elapsed();
        assert!(child.wait().expect("it can be waited for").success(), "a run that is left alone succeeds");
        let whole = begin.elapsed();
        Self { whole, writing: whole - seen, rng: Rng::new(1), count }
    }
}

impl Iterator for Moments {
    type Item = Moment;

    fn next(&mut self) -> Option<Moment> {
        self.count = self.count.checked_sub(1)?;
        let share = BEYOND * self.rng.uniform();
        // In pairs, so that tests may treat every other run differently.
        Some(match self.count % 4 < 2 {
            true => Moment::Start(self.whole.mul_f32(share)),
            false => Moment::Sign(self.writing.mul_f32(share)),
        })
    }
}

/// Waits for the sign; false when the program ends before.
fn wait_for(child: &mut Child, sign: impl Fn() -> bool) -> bool {
    while !sign() {
        if child.try_wait().expect("it can be asked").is_some() {
            return false;
        }
        std::thread::sleep(LOOK);
    }
    true
}

fn wait_until(child: &mut Child, moment: Moment, sign: impl Fn() -> bool) {
    match moment {
        Moment::Start(delay) => std::thread::sleep(delay),
        Moment::Sign(delay) if wait_for(child, sign) => std::thread::sleep(delay),
        Moment::Sign(_) => {}
    }
}

/// Starts a program whose words nobody needs.
fn start(mut command: Command) -> Child {
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts")
}

/// Kills a program outright at a moment, unless it has ended before.
pub fn kill_at(command: Command, moment: Moment, sign: impl Fn() -> bool) -> ExitStatus {
    let mut child = start(command);
    wait_until(&mut child, moment, sign);
    child.kill().expect("killed, or ended before");
    child.wait().expect("it can be waited for")
}

/// Sends Ctrl-C's signal at a moment and waits for the end.
pub fn interrupt_at(command: Command, moment: Moment, sign: impl Fn() -> bool) -> ExitStatus {
    let mut child = start(command);
    wait_until(&mut child, moment, sign);
    interrupt(&child);
    child.wait().expect("it can be waited for")
}

/// Sends Ctrl-C's signal twice as soon as there is a sign, and waits for the end.
pub fn interrupt_twice(command: Command, sign: impl Fn() -> bool) -> ExitStatus {
    let mut child = start(command);
    if wait_for(&mut child, sign) {
        interrupt(&child);
        interrupt(&child);
    }
    child.wait().expect("it can be waited for")
}

/// Sends Ctrl-C's signal. A program that has ended already is no failure.
pub fn interrupt(child: &Child) {
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).stderr(Stdio::null()).status();
    kill.expect("the command kill");
}

/// Whether a program was interrupted in the proper way: code 130, or ended by the signal itself when that came before
/// the program had begun to listen, for which shells say 130 too.
pub fn was_interrupted(status: ExitStatus) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::process::ExitStatusExt;
        const SIGINT: i32 = 2;
        if status.signal() == Some(SIGINT) {
            return true;
        }
    }
    status.code() == Some(130)
}

/// Names in a folder, sorted; none when there is no folder.
pub fn names_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.expect("entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Names of unfinished files in a folder.
pub fn unfinished_in(folder: &Path) -> Vec<String> {
    names_in(folder).into_iter().filter(|name| name.starts_with(".sspc-")).collect()
}

/// Runs a program that can write no more than `kilobytes` to any file: what a full disk does, without filling one.
pub fn with_full_disk(command: &Command, kilobytes: u32) -> Output {
    let mut limited = Command::new("bash");
    limited.args(["-c", &format!("ulimit -f {kilobytes}; trap '' XFSZ; exec \"$0\" \"$@\"")]);
    limited.arg(command.get_program()).args(command.get_args());
    if let Some(folder) = command.get_current_dir() {
        limited.current_dir(folder);
    }
    limited.output().expect("bash starts")
}

/// The writing end of a pipe that nobody reads.
pub fn closed_pipe() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

/// A file whose disk is full, where the system has one.
pub fn full_device() -> Option<Stdio> {
    std::fs::OpenOptions::new().write(true).open("/dev/full").ok().map(Stdio::from)
}

/// Takes the right to write from a folder and gives the program in a form that is bound by it: itself, or for root
/// without root's power over permissions. `None`, said aloud, where neither is possible.
#[cfg(unix)]
pub fn bound_by_permissions(folder: &Path, command: &Command) -> Option<Command> {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(folder, std::fs::Permissions::from_mode(0o555)).expect("the folder is ours");
    let probe = folder.join("probe");
    let binds = |mut touch: Command| {
        let bound = touch.arg(&probe).stderr(Stdio::null()).status().is_ok_and(|status| !status.success());
        let _ = std::fs::remove_file(&probe);
        bound
    };
    let again = |mut to: Command| {
        to.arg(command.get_program()).args(command.get_args());
        to
    };
    if binds(Command::new("touch")) {
        let mut plain = Command::new(command.get_program());
        plain.args(command.get_args());
        return Some(plain);
    }
    let powerless = || {
        let mut command = Command::new("setpriv");
        command.arg("--bounding-set=-dac_override,-dac_read_search");
        command
    };
    let mut touch = powerless();
    touch.arg("touch");
    if binds(touch) && powerless().arg("true").status().is_ok_and(|status| status.success()) {
        return Some(again(powerless()));
    }
    skipped("a folder that may not be written to", "nothing binds this user to permissions (root, without setpriv)");
    None
}
