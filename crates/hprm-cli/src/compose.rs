//! `hprm compose`: what a program needs to run in containers, as files.
//!
//! This module decides which files there are and writes them; their texts are made in `texts.rs`. It starts no
//! container.

mod texts;

use std::fs;
use std::io;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

use hprm_model::{Compiled, Containers};

use crate::args::Compose;
use crate::message::{self, Error};
use crate::{check, declare, draft};
use texts::{Image, Plan};

/// The file in which compose looks for values of variables: it has the secret.
const ENVIRONMENT: &str = ".env";

/// A file to write: its path in the folder, and its text.
type Text = (PathBuf, String);

/// Writes the files.
///
/// # Errors
///
/// If the program has none, or something is there already.
pub(crate) fn compose(wanted: &Compose) -> Result<ExitCode, Error> {
    let compiled = match check::checked(&wanted.program())? {
        Ok(compiled) => compiled,
        Err(code) => return Ok(code),
    };
    check::show_warnings(&compiled);
    let places = Places::of(wanted, &compiled)?;
    let stated = compiled.settings.containers.clone().unwrap_or_default();
    let plan = plan(wanted, &compiled, &stated, &places)?;
    let mut files = texts::files(&plan);
    if let Some(path) = &stated.compose_override {
        let beside = places.program_folder().join(path);
        let text = fs::read_to_string(&beside).map_err(|error| unreadable(&beside, &error))?;
        files.push(("docker-compose.override.yml".into(), text));
    }
    refuse_existing(wanted, &places, &files)?;
    write(wanted, &places, &files).map_err(|error| {
        Error::new(format!(
            "cannot write in {}: {}",
            places.output.display(),
            message::reason(&error)
        ))
    })?;
    let output = places.output.display();
    message::print_line(&format!(
        "wrote {output}: the RTI and {} federates\n  docker compose --file {output}/docker-compose.yml up --build",
        plan.federates().count()
    ));
    Ok(ExitCode::SUCCESS)
}

/// Where things are.
#[derive(Debug)]
struct Places {
    /// The program, without the name of a reactor.
    file: PathBuf,
    /// What becomes part of the images, without links.
    context: PathBuf,
    /// Where the files go, as it is typed.
    output: PathBuf,
}

impl Places {
    fn of(wanted: &Compose, compiled: &Compiled) -> Result<Self, Error> {
        let file = declare::file_of(&wanted.file);
        let found = |path: &Path| path.canonicalize().map_err(|error| unreadable(path, &error));
        let folder = match file.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        let context = found(wanted.context.as_deref().unwrap_or(folder))?;
        for path in compiled.sources.paths() {
            let path = found(Path::new(path))?;
            if !path.starts_with(&context) {
                let (path, context) = (path.display(), context.display());
                return Err(Error::option(format!(
                    "{path} is a file of the program and not in {context}"
                ))
                .hint("name a folder that has all of them: --context FOLDER"));
            }
        }
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let beside = || folder.join(format!("{stem}-containers"));
        let output = wanted.output.clone().unwrap_or_else(beside);
        // A program without folder is shown without one, too.
        let output = output.strip_prefix(".").map_or(output.clone(), Path::to_owned);
        Ok(Self { file: found(file)?, context, output })
    }

    /// Where the files go, without links; the folder may be missing.
    fn absolute_output(&self) -> Result<PathBuf, Error> {
        let absolute =
            std::path::absolute(&self.output).map_err(|error| unreadable(&self.output, &error))?;
        let there =
            absolute.ancestors().find_map(|folder| Some((folder, folder.canonicalize().ok()?)));
        Ok(there.map_or(absolute.clone(), |(folder, real)| {
            real.join(absolute.strip_prefix(folder).expect("it is one of its ancestors"))
        }))
    }

    fn program_folder(&self) -> &Path {
        self.file.parent().expect("a file is in a folder")
    }
}

fn plan(
    wanted: &Compose,
    compiled: &Compiled,
    stated: &Containers,
    places: &Places,
) -> Result<Plan, Error> {
    let program = &compiled.program;
    if program.federates.is_empty() {
        return Err(Error::new(format!("{} is no federation", wanted.file.display()))
            .hint("a federated reactor has a container for each federate; any image with Python runs another program"));
    }
    if let Some(federate) = compiled.executables.keys().next() {
        let name = &program.federates[*federate].name;
        return Err(Error::new(format!(
            "federate {name} is an executable, for which no image can be made"
        ))
        .hint("the handbook page howto/containers says what goes into an image"));
    }
    let wheel = wanted.wheel.as_deref().map(wheel_name).transpose()?;
    if wheel.is_none() && stated.runner_base.is_none() {
        return Err(Error::option("the images would have no HPRM")
            .hint("name a wheel, which `make wheel` makes in a clone: --wheel FILE; or an image that has HPRM: docker: { runner-base: ... }"));
    }
    let image = Image {
        base: stated.runner_base.clone().unwrap_or_else(|| base_for(wheel.as_deref())),
        wheel,
        requirements: places.context.join("requirements.txt").is_file(),
        before: stated.pre_build_script.clone(),
        after: stated.post_build_script.clone(),
        before_run: stated.pre_run_script.clone(),
    };
    let inside = places.file.strip_prefix(&places.context).expect("all files are in the context");
    let mut file = text(inside)?;
    if let Some(reactor) = declare::reactor_of(&wanted.file) {
        file = format!("{file}:{reactor}");
    }
    let output = places.absolute_output()?;
    let env_file = stated.env_file.as_ref().map(|path| places.program_folder().join(path));
    if let Some(path) = env_file.as_ref().filter(|path| !path.is_file()) {
        return Err(Error::option(format!("there is no file {}", path.display())).hint(
            "the option env-file of the target property docker names it, beside the program",
        ));
    }
    Ok(Plan {
        program: file,
        federates: program.federates.values().map(|federate| federate.name.clone()).collect(),
        properties: wanted.properties.stated(),
        context: text(&relative(&output, &places.context))?,
        output: text(&relative(&places.context, &output))?,
        image,
        rti_image: stated.rti_image.clone(),
        env_file: env_file.map(|path| text(&relative(&output, &path))).transpose()?,
        realtime: program.properties.realtime.is_some(),
    })
}

/// The path from one folder to another one; both are absolute.
fn relative(from: &Path, to: &Path) -> PathBuf {
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    let path: PathBuf = up.chain(to.components().skip(common)).collect();
    if path.as_os_str().is_empty() { PathBuf::from(".") } else { path }
}

/// What images start from unless the program names it: the version of Python that the wheel is for.
fn base_for(wheel: Option<&str>) -> String {
    let tag = wheel.and_then(|name| name.split('-').nth(2));
    let minor = tag.and_then(|tag| tag.strip_prefix("cp3")).unwrap_or("12");
    format!("python:3.{}-slim", minor.trim_end_matches('t'))
}

/// A path as text: the files that are written are text.
fn text(path: &Path) -> Result<String, Error> {
    let text = path.to_str().filter(|text| !text.contains(char::is_control));
    text.map(str::to_owned).ok_or_else(|| {
        Error::new(format!("the path {} cannot stand in a Dockerfile", path.display()))
            .hint("rename its folders")
    })
}

fn wheel_name(path: &Path) -> Result<String, Error> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    if !path.is_file() || !name.starts_with("hprm-") || !name.ends_with(".whl") {
        return Err(Error::option(format!("{} is no wheel of HPRM", path.display()))
            .hint("`make wheel` in a clone of the repository makes one, in out/wheels"));
    }
    if name.ends_with("-linux_x86_64.whl") || name.ends_with("-linux_aarch64.whl") {
        return Err(Error::option(format!("the wheel {name} is for this machine only"))
            .hint("`make wheel` makes one for other distributions, as those of images are"));
    }
    Ok(name.to_owned())
}

fn refuse_existing(wanted: &Compose, places: &Places, files: &[Text]) -> Result<(), Error> {
    if wanted.force {
        return Ok(());
    }
    let wheel = wanted.wheel.iter().filter_map(|path| path.file_name()).map(Path::new);
    let names = files.iter().map(|(path, _)| path.as_path()).chain(wheel);
    let existing =
        names.map(|name| places.output.join(name)).find(|path| path.symlink_metadata().is_ok());
    existing.map_or(Ok(()), |path| {
        Err(Error::new(format!("{} exists already", path.display()))
            .hint("--force replaces it, --output FOLDER writes elsewhere"))
    })
}

fn write(wanted: &Compose, places: &Places, files: &[Text]) -> io::Result<()> {
    let Places { output, .. } = places;
    for (path, text) in files {
        let path = output.join(path);
        fs::create_dir_all(path.parent().expect("it is in a folder"))?;
        draft::replace(&path, |draft| fs::write(draft, text))?;
    }
    if let Some(wheel) = &wanted.wheel {
        let name = wheel.file_name().expect("its name was looked at");
        draft::replace(&output.join(name), |draft| fs::copy(wheel, draft).map(|_| ()))?;
    }
    let environment = output.join(ENVIRONMENT);
    if environment.symlink_metadata().is_ok() {
        return Ok(());
    }
    let secret = hprm::random_federation().map_err(|_| io::Error::other("no random numbers"))?;
    draft::replace(&environment, |draft| {
        let mut file =
            fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(draft)?;
        writeln!(
            file,
            "# The secret of the federation: a process that knows it can join.\nHPRM_FEDERATION_ID={secret}"
        )
    })
}

fn unreadable(path: &Path, error: &io::Error) -> Error {
    Error::new(format!("cannot read {}: {}", path.display(), message::reason(error)))
}
