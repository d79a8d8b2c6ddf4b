//! The words of the command that are about credentials: `hprm agent authority`, `invite`, `enroll`,
//! `revoke` and `renew`.

use std::io::Write;
use std::time::Duration;

use clap::{Args, Subcommand};
use hprm::agent::is_name;

use super::authority::{self, Authority, Renewed, Which};
use super::lifetime::date;
use super::{CERTIFICATES, Credentials, enroll, invite, now};
use crate::Failure;
use crate::options::host_name;

/// What the command does instead of running an agent.
#[derive(Subcommand, Debug)]
pub(crate) enum Word {
    /// Make an authority on this machine, which says which machines belong together, and enroll this machine
    Authority(AuthorityOptions),
    /// Let a machine enroll: print a code that works once, and wait for that machine
    Invite(Invite),
    /// Get a certificate for this machine from the authority of another one; the code is asked for
    Enroll(Enroll),
    /// Take a machine out: all others refuse it from now on
    Revoke(Revoke),
    /// Sign the certificates of machines again, so that they are valid for another year
    Renew(Renew),
}

#[derive(Args, Debug)]
pub(crate) struct AuthorityOptions {
    /// The name of this machine; by default its host name
    #[arg(long)]
    name: Option<String>,
    /// This machine is a router, as with `hprm agent invite --router`
    #[arg(long)]
    router: bool,
}

#[derive(Args, Debug)]
pub(crate) struct Invite {
    /// The name of the machine
    machine: String,
    /// Where that machine reaches this one
    #[arg(long, value_name = "HOST:PORT", default_value = "0.0.0.0:7651")]
    listen: String,
    /// For how many minutes the code is valid
    #[arg(long, value_name = "MINUTES", default_value_t = 10.0, value_parser = minutes)]
    valid: f64,
    /// The machine is a router: its agent leads what others send that do not reach one another, and can read and change
    /// that
    #[arg(long)]
    router: bool,
}

#[derive(Args, Debug)]
pub(crate) struct Enroll {
    /// Where `hprm agent invite` listens
    #[arg(long, value_name = "HOST:PORT")]
    authority: String,
    /// The name of this machine, as it was invited; by default its host name
    #[arg(long)]
    name: Option<String>,
}

#[derive(Args, Debug)]
pub(crate) struct Revoke {
    /// The name of the machine
    machine: String,
}

#[derive(Args, Debug)]
pub(crate) struct Renew {
    /// The names of the machines; by default all of them
    machines: Vec<String>,
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes = text.parse::<f64>().ok();
    let minutes = minutes.filter(|minutes| *minutes > 0.0 && *minutes <= 24.0 * 60.0);
    minutes.ok_or_else(|| "write minutes, at most those of a day, as in --valid 10".to_owned())
}

/// Does what the words say.
///
/// # Errors
///
/// What the user is told.
pub(crate) fn run(word: &Word) -> Result<(), Failure> {
    match word {
        Word::Authority(options) => make(options),
        Word::Invite(options) => admit(options),
        Word::Enroll(options) => join(options),
        Word::Revoke(options) => revoke(options),
        Word::Renew(options) => renew(options),
    }
}

fn make(options: &AuthorityOptions) -> Result<(), Failure> {
    let name = options.name.clone().unwrap_or_else(host_name);
    check(&name)?;
    let mut authority = Authority::make(now())?;
    let (key, request) = authority::request(&name)?;
    let admission = authority.admit(&name, options.router, &request, now())?;
    let credentials = Credentials::keep(&key, &admission)?;
    say(&format!(
        "the authority is in {}: whoever reads its key can be any machine\n\
         this machine is {name}, and has its credentials in {}\n\
         hprm agent invite MACHINE lets another one enroll\n",
        authority.folder().display(),
        credentials.folder().display()
    ));
    Ok(())
}

fn admit(options: &Invite) -> Result<(), Failure> {
    let Invite { machine, listen, valid, router } = options;
    check(machine)?;
    let mut authority = Authority::open()?;
    let until = Duration::from_secs_f64(valid * 60.0);
    let (host, code) = invite::Host::listen(listen, machine, *router, until)?;
    let place = host.place();
    say(&format!(
        "on {machine}: hprm agent enroll --name {machine} --authority {place}\n\
         code: {code}\n\
         the code works once, within {valid} minutes; 0.0.0.0 stands for the address of this machine\n"
    ));
    host.admit(&mut authority)?;
    spread(&authority)?;
    say(&format!("{machine} is enrolled\n"));
    Ok(())
}

fn join(options: &Enroll) -> Result<(), Failure> {
    let name = options.name.clone().unwrap_or_else(host_name);
    check(&name)?;
    let code = enroll::ask()?;
    let enrolled = enroll::enroll(&options.authority, &name, &code)?;
    let credentials = Credentials::keep(&enrolled.key, &enrolled.admission)?;
    say(&format!(
        "this machine is {name}, and has its credentials in {}\n",
        credentials.folder().display()
    ));
    Ok(())
}

fn revoke(options: &Revoke) -> Result<(), Failure> {
    let machine = &options.machine;
    let mut authority = Authority::open()?;
    authority.revoke(machine)?;
    spread(&authority)?;
    say(&format!(
        "{machine} is revoked: machines refuse it that can reach this one's agent, or one that knows\n"
    ));
    Ok(())
}

fn renew(options: &Renew) -> Result<(), Failure> {
    let which = match &*options.machines {
        [] => Which::All,
        machines => Which::Named(machines),
    };
    let mut authority = Authority::open()?;
    let (renewed, is_spread) = sign_again(&mut authority, &which)?;
    if !renewed.machines.is_empty() {
        let path = authority.folder().join(CERTIFICATES);
        let path = path.display();
        say(&format!("{}\n", told(&renewed, &authority)));
        say(&match is_spread {
            true => "machines take their certificates when they reach this one's agent, or one that knows\n".to_owned(),
            false => format!("copy {path} into ~/.config/hprm/agent of any machine; its agent tells the others\n"),
        });
    }
    if renewed.unknown.is_empty() {
        return Ok(());
    }
    let names = renewed.unknown.join(", ");
    Err(Failure::new(format!("not renewed, because their certificates are not known here: {names}"))
        .hint("run the agent of this machine while theirs are connected, and try again; or invite them again"))
}

/// Renews the certificates that end soonest, if this user has the authority of these credentials. Returns what was done.
///
/// # Errors
///
/// If they cannot be renewed.
pub(crate) fn renew_due(credentials: &Credentials) -> Result<Option<String>, Failure> {
    let Some(mut authority) = Authority::find()? else { return Ok(None) };
    if authority.public_key() != credentials.authority.key {
        return Ok(None);
    }
    let (renewed, _) = sign_again(&mut authority, &Which::Due)?;
    Ok((!renewed.machines.is_empty()).then(|| told(&renewed, &authority)))
}

/// Returns what was done, and whether the agent of this machine has it.
fn sign_again(authority: &mut Authority, which: &Which<'_>) -> Result<(Renewed, bool), Failure> {
    // Credentials of this machine that cannot be used are no reason not to renew certificates of others.
    let credentials = Credentials::read().ok().flatten();
    let known = credentials.as_ref().and_then(|it| it.certificates_beside(""));
    let renewed = authority.renew(which, known.unwrap_or_default().as_bytes(), now())?;
    let credentials = credentials.filter(|it| it.authority.key == authority.public_key());
    if let Some(credentials) = &credentials {
        let news = credentials.news(authority.certificates().as_bytes());
        credentials.keep_certificates(news.map_err(Failure::new)?)?;
    }
    Ok((renewed, credentials.is_some()))
}

fn told(renewed: &Renewed, authority: &Authority) -> String {
    let (names, ends) = (renewed.machines.join(", "), date(renewed.ends));
    let last = match renewed.ends == authority.ends() {
        true => " (as that of the authority, after which all machines enroll with another one)",
        false => "",
    };
    format!("renewed until {ends}{last}: {names}")
}

/// Gives the roster to the agent of this machine, if it has that authority; it tells the others.
fn spread(authority: &Authority) -> Result<(), Failure> {
    // Credentials of this machine that cannot be used are no reason to keep the roster from nobody else.
    let Ok(Some(credentials)) = Credentials::open() else { return Ok(()) };
    credentials.learn(authority.signed()?.as_bytes())
}

fn check(name: &str) -> Result<(), Failure> {
    if is_name(name) {
        return Ok(());
    }
    Err(Failure::new(format!("'{name}' cannot be the name of a machine"))
        .hint("names have letters, digits, and '-', '_' or '.' between them"))
}

/// Prints what a person waits for.
fn say(text: &str) {
    print!("{text}");
    // Without a reader, there is nobody to be told.
    let _ = std::io::stdout().flush();
}
