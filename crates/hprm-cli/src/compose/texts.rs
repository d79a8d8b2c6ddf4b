//! The texts of the files for containers: a Dockerfile for each service, and the file that compose reads.
//!
//! Texts in YAML are quoted as in JSON, which YAML contains.

use std::fmt::Write as _;
use std::path::PathBuf;

use serde_json::Value;

/// The port of the RTI, within the network of the containers.
const PORT: u16 = 15045;

/// The user of the processes, with no rights beyond the program.
const USER: &str = "1000";

/// What is to be written.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Plan {
    /// The program, within the context.
    pub(super) program: String,
    pub(super) federates: Vec<String>,
    /// Target properties that replace the program's.
    pub(super) properties: Vec<String>,
    /// What becomes part of images, seen from the folder that is written.
    pub(super) context: String,
    /// The folder that is written, seen from there.
    pub(super) output: String,
    pub(super) image: Image,
    pub(super) rti_image: Option<String>,
    pub(super) env_file: Option<String>,
    /// Whether processes ask for real-time priorities.
    pub(super) realtime: bool,
}

/// What an image is made of.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Image {
    /// What it starts from.
    pub(super) base: String,
    /// The name of a wheel to install.
    pub(super) wheel: Option<String>,
    /// Whether the context has a requirements.txt.
    pub(super) requirements: bool,
    pub(super) before: Option<String>,
    pub(super) after: Option<String>,
    pub(super) before_run: Option<String>,
}

/// What a container does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Role<'a> {
    Rti,
    Federate(&'a str),
}

impl Plan {
    pub(super) fn federates(&self) -> impl Iterator<Item = Role<'_>> {
        self.federates.iter().map(|name| Role::Federate(name))
    }

    fn roles(&self) -> impl Iterator<Item = Role<'_>> {
        std::iter::once(Role::Rti).chain(self.federates())
    }

    /// The name of the service, which is the name of the container in the network.
    fn service(&self, role: Role<'_>) -> String {
        match role {
            Role::Federate(name) => name.to_owned(),
            Role::Rti if self.federates.iter().all(|name| name != "rti") => "rti".to_owned(),
            Role::Rti => "hprm-rti".to_owned(),
        }
    }

    /// What a container runs.
    fn command(&self, role: Role<'_>) -> Vec<String> {
        let words = match role {
            Role::Rti => vec!["rti".to_owned(), "--listen".to_owned(), format!("0.0.0.0:{PORT}")],
            Role::Federate(_) => {
                let rti = format!("{}:{PORT}", self.service(Role::Rti));
                vec!["federate".to_owned(), "--rti".to_owned(), rti]
            }
        };
        let properties = self.properties.iter().map(|stated| format!("--property={stated}"));
        let name = match role {
            Role::Rti => None,
            Role::Federate(name) => Some(name.to_owned()),
        };
        std::iter::once("hprm".to_owned())
            .chain(words)
            .chain(properties)
            .chain([self.program.clone()])
            .chain(name)
            .collect()
    }
}

/// All files: their paths in the folder, and their texts.
pub(super) fn files(plan: &Plan) -> Vec<(PathBuf, String)> {
    let mut files = vec![
        (PathBuf::from("docker-compose.yml"), compose(plan)),
        (PathBuf::from(".gitignore"), "# The secret of the federation.\n.env\n".to_owned()),
    ];
    for role in plan.roles() {
        let folder = PathBuf::from(plan.service(role));
        files.push((folder.join("Dockerfile"), dockerfile(plan, role)));
        files.push((folder.join("Dockerfile.dockerignore"), IGNORED.to_owned()));
    }
    files
}

/// What no image needs, above all the secret.
const IGNORED: &str = "\
**/.env
**/.git
**/.venv
**/__pycache__
**/target
";

fn dockerfile(plan: &Plan, role: Role<'_>) -> String {
    let image = &plan.image;
    let base = match (role, &plan.rti_image) {
        (Role::Rti, Some(base)) => base,
        _ => &image.base,
    };
    let what = match role {
        Role::Rti => "The RTI".to_owned(),
        Role::Federate(name) => format!("Federate {name}"),
    };
    let mut text = format!("# {what} of {}.\nFROM {base}\n", plan.program);
    text += "ENV PYTHONUNBUFFERED=1\n";
    if let Some(wheel) = &image.wheel {
        let installed = format!("/tmp/{wheel}");
        let copy = list(&[wheel, "/tmp/"]);
        let install = list(&["pip", "install", "--no-cache-dir", &installed]);
        // From a second context, the folder of these files.
        let _ = writeln!(
            text,
            "# hadolint ignore=DL3022\nCOPY --from=containers {copy}\nRUN {install}"
        );
    }
    text += "WORKDIR /program\n";
    if image.requirements {
        let install = list(&["pip", "install", "--no-cache-dir", "-r", "requirements.txt"]);
        let _ = writeln!(text, "COPY requirements.txt ./\nRUN {install}");
    }
    if let Some(script) = &image.before {
        let (copy, run) = (list(&[script, script]), list(&["sh", script]));
        let _ = writeln!(text, "COPY {copy}\nRUN {run}");
    }
    let _ = writeln!(text, "COPY --chown={USER} . ./");
    if let Some(script) = &image.after {
        let _ = writeln!(text, "RUN {}", list(&["sh", script]));
    }
    // A process without privileges; real-time priorities are given to root.
    if !plan.realtime {
        let own = list(&["chown", USER, "/program"]);
        let _ = writeln!(text, "RUN {own}\nUSER {USER}");
    }
    let mut command = plan.command(role);
    if let Some(script) = &image.before_run {
        // The script is over before the federate takes its place.
        let first = ["sh", "-c", "sh \"$0\" && exec \"$@\"", script];
        command.splice(0..0, first.map(str::to_owned));
    }
    let command: Vec<_> = command.iter().map(String::as_str).collect();
    let _ = writeln!(text, "ENTRYPOINT {}", list(&command));
    text
}

/// Words as a Dockerfile has them where no shell is to read them.
fn list(words: &[&str]) -> String {
    let words: Vec<_> = words.iter().map(|word| Value::from(*word).to_string()).collect();
    format!("[{}]", words.join(", "))
}

fn compose(plan: &Plan) -> String {
    let mut text = format!(
        "# {}: the RTI and each federate in a container of its own.\n\
         # The secret of the federation is in .env, which belongs to its owner.\nservices:\n",
        plan.program
    );
    let rti = plan.service(Role::Rti);
    for role in plan.roles() {
        let name = plan.service(role);
        let dockerfile = format!("{}/{name}/Dockerfile", plan.output);
        let _ = write!(
            text,
            "  {}:\n    build:\n      context: {}\n      dockerfile: {}\n",
            quoted(&name),
            quoted(&plan.context),
            quoted(&dockerfile)
        );
        if plan.image.wheel.is_some() {
            text += "      additional_contexts:\n        containers: .\n";
        }
        if role != Role::Rti {
            let _ = writeln!(text, "    depends_on:\n      - {}", quoted(&rti));
        }
        if let Some(path) = &plan.env_file {
            let _ = writeln!(text, "    env_file:\n      - {}", quoted(path));
        }
        text += "    environment:\n      HPRM_FEDERATION_ID: ${HPRM_FEDERATION_ID:?it is in the file .env}\n";
        if plan.realtime {
            text += "    cap_add:\n      - SYS_NICE\n      - IPC_LOCK\n";
        }
        text += "    init: true\n";
    }
    text
}

/// A text of YAML in which compose looks for no variables.
fn quoted(text: &str) -> String {
    Value::String(text.replace('$', "$$")).to_string()
}
