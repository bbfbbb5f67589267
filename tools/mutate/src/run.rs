//! One run of the command on one file, and what it must keep to.

use std::{
    fs,
    io::Read as _,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::{LONGEST, MEMORY_KIB};

/// A run: `{}` in the arguments is the file.
pub(crate) struct Run<'a> {
    pub(crate) command: &'a Path,
    pub(crate) folder: &'a Path,
    pub(crate) name: &'a str,
    pub(crate) arguments: &'a str,
}

/// The commands that read a file of this name; other files are those of `make_seeds`.
pub(crate) fn commands_for(name: &str) -> &'static [&'static str] {
    let stem = name.split('.').next().unwrap_or_default();
    match (stem, name.rsplit('.').next().unwrap_or_default()) {
        ("map", "glb") => &["plot {} -o -", "lookup {} contacts.csv -o -", "build {} -o out", "info {}"],
        ("contacts", _) => &["lookup map.glb {} -o -"],
        ("readings", "jsonl") => &["render map.glb {} --layout xela.json -o -", "layout {}"],
        ("readings", "asf" | "lst" | "asc") => {
            &["render map.glb {} -o - --level 1", "convert {} out.ply", "layout {}"]
        }
        ("readings", _) => &["render map.glb {} -o - --to 1 --level 1"],
        ("seams", _) => &["flatten cap.obj --cut {} -o out.npz"],
        ("observations", _) => &["calibrate {} -o out.csv --iterations 3 --keep"],
        ("arm", _) => &["info {}", "build {} -o out", "build {} -o out --spacing 2cm --outer"],
        (_, "g2o") => &["calibrate {} -o out.csv --iterations 3 --keep"],
        _ => &[
            "info {}",
            "build {} -o out",
            "check {} --repair",
            "flatten {} -o out.npz",
            "convert {} out.ply --repair --weld none",
        ],
    }
}

impl Run<'_> {
    /// Runs the command on a file with these bytes.
    ///
    /// # Errors
    /// What the run broke.
    pub(crate) fn check(&self, bytes: &[u8]) -> Result<(), String> {
        let file = self.folder.join(format!("damaged-{}", self.name));
        fs::write(&file, bytes).map_err(|e| e.to_string())?;
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let arguments = self.arguments.replace("{}", &name);
        let script = format!("ulimit -v {MEMORY_KIB}; exec \"$0\" {arguments} --threads 2 --quiet");
        let mut child = Command::new("sh")
            .args(["-c", &script])
            .arg(self.command)
            .current_dir(self.folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| e.to_string())?;
        let pipe = child.stderr.take();
        let said = thread::spawn(move || {
            let mut text = Vec::new();
            pipe.map(|mut pipe| pipe.read_to_end(&mut text));
            String::from_utf8_lossy(&text).into_owned()
        });
        let start = Instant::now();
        let status = loop {
            match child.try_wait().map_err(|e| e.to_string())? {
                Some(status) => break status,
                None if start.elapsed() > LONGEST => {
                    child.kill().map_err(|e| e.to_string())?;
                    child.wait().map_err(|e| e.to_string())?;
                    return Err(format!("not done after {} s", LONGEST.as_secs()));
                }
                None => thread::sleep(Duration::from_millis(2)),
            }
        };
        let said = said.join().unwrap_or_default();
        if said.contains("panicked") {
            return Err(said);
        }
        match status.code() {
            Some(0..=2) => Ok(()),
            _ => Err(format!("{status}: {said}")),
        }
    }
}
