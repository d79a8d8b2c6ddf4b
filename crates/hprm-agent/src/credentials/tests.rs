//! Certificates that an authority signs again: who gets one, and which of them an agent takes.

use std::fs;
use std::path::Path;

use rcgen::{CertificateParams, IsCa, Issuer, KeyPair};
use tempfile::TempDir;

use super::authority::{self, Authority, Which};
use super::lifetime::{AUTHORITY_DAYS, DAY, MACHINE_DAYS};
use super::roster::MACHINES;
use super::*;

/// 2026-11-27, at noon.
const NOW: i64 = 1_795_780_800;

struct Place {
    folder: TempDir,
    authority: Authority,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let authority = Authority::make_in(folder.path().join("authority"), NOW).unwrap();
        Self { folder, authority }
    }

    /// Enrolls a machine, in a folder of its name.
    fn enroll(&mut self, name: &str, now: i64) -> Credentials {
        let (key, request) = authority::request(name).unwrap();
        let admission = self.authority.admit(name, false, &request, now).unwrap();
        let folder = self.folder.path().join(name);
        files::make(&folder).unwrap();
        for (file, text) in [
            (AUTHORITY, &admission.authority),
            (KEY, &key),
            (CERTIFICATE, &admission.certificate),
            (ROSTER, &admission.roster),
        ] {
            files::write(&folder.join(file), text.as_bytes()).unwrap();
        }
        read(&folder)
    }

    fn renew(&mut self, which: &Which<'_>, now: i64) -> authority::Renewed {
        self.authority.renew(which, b"", now).unwrap()
    }
}

fn read(folder: &Path) -> Credentials {
    Credentials::read_in(folder.to_owned(), None).unwrap().unwrap()
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

#[test]
fn a_renewed_certificate_is_for_the_same_name_and_key_and_is_taken_once() {
    let mut place = Place::new();
    let robot = place.enroll("robot2", NOW);
    let later = NOW + 300 * DAY;
    let renewed = place.renew(&Which::All, later);
    assert_eq!((renewed.machines, renewed.unknown), (names(&["robot2"]), names(&[])));
    assert_eq!(renewed.ends, later + MACHINE_DAYS * DAY);
    let text = place.authority.certificates();
    let news = robot.news(text.as_bytes()).unwrap();
    robot.keep_certificates(news.clone()).unwrap();
    assert!(robot.is_stale());
    let after = read(&robot.folder);
    let (old, new) = (&robot.certificate, &after.certificate);
    assert_eq!((&old.subject, &old.key, old.begins), (&new.subject, &new.key, new.begins));
    assert_eq!((new.ends, new), (renewed.ends, &news[0]));
    assert_eq!(after.renewed_since(&robot).as_deref(), Some("2028-09-22"));
    assert_eq!((after.is_stale(), after.renewed_since(&after)), (false, None));
    assert_eq!(robot.read_again().unwrap().unwrap().certificate, *new);
    // Neither the same once more nor the old one changes anything.
    assert_eq!(after.news(text.as_bytes()), Ok(Vec::new()));
    assert_eq!(after.news(old.pem().as_bytes()), Ok(Vec::new()));
    after.keep_certificates(vec![old.clone()]).unwrap();
    assert_eq!(read(&robot.folder).certificate, *new);
    // Files are complete, and nothing else is left.
    assert_eq!(fs::read_dir(&robot.folder).unwrap().count(), 5);
}

#[test]
fn of_several_rosters_the_latest_is_kept_whichever_comes_first() {
    let mut place = Place::new();
    let robot = place.enroll("robot2", NOW);
    let [third, fourth] = ["robot3", "robot4"].map(|name| place.enroll(name, NOW));
    let kept = || read(&robot.folder).roster().number;
    for (text, number) in [
        (third.signed_roster(), 2),
        (fourth.signed_roster(), 3),
        (third.signed_roster(), 3),
        (robot.signed_roster(), 3),
        (&b"no roster"[..], 3),
    ] {
        robot.learn(text).unwrap();
        assert_eq!(kept(), number);
    }
    // What is no roster does not keep one from being learnt.
    files::write(&robot.folder.join(ROSTER), b"no roster").unwrap();
    robot.learn(robot.signed_roster()).unwrap();
    assert!(Credentials::read_in(robot.folder.clone(), None).is_err());
    robot.learn(third.signed_roster()).unwrap();
    assert_eq!(kept(), 2);
}

#[test]
fn machines_are_renewed_that_are_on_the_roster_and_known() {
    let mut place = Place::new();
    place.enroll("robot2", NOW);
    let third = place.enroll("robot3", NOW);
    place.enroll("robot4", NOW);
    place.authority.revoke("robot4").unwrap();
    let later = NOW + 100 * DAY;
    let named = place.renew(&Which::Named(&names(&["robot3"])), later);
    assert_eq!(named.machines, names(&["robot3"]));
    assert_eq!(place.renew(&Which::All, later).machines, names(&["robot2", "robot3"]));
    for stranger in ["robot4", "robot9"] {
        let failure = place.authority.renew(&Which::Named(&names(&[stranger])), b"", later);
        let text = failure.unwrap_err().to_string();
        assert!(text.contains(stranger) && text.ends_with("there are: robot2, robot3"), "{text}");
    }
    // An authority of an earlier version has no such file, until an agent knows the certificates.
    fs::remove_file(place.authority.folder().join(CERTIFICATES)).unwrap();
    assert_eq!(place.renew(&Which::All, later).unknown, names(&["robot2", "robot3"]));
    let known = third.certificates_beside("").unwrap();
    let renewed = place.authority.renew(&Which::All, known.as_bytes(), later).unwrap();
    assert_eq!((renewed.machines, renewed.unknown), (names(&["robot3"]), names(&["robot2"])));
}

#[test]
fn an_authority_renews_by_itself_what_is_in_its_last_third() {
    let mut place = Place::new();
    place.enroll("old", NOW);
    place.enroll("young", NOW + 100 * DAY);
    assert_eq!(place.renew(&Which::Due, NOW + 243 * DAY).machines, names(&[]));
    let day = NOW + 244 * DAY;
    assert_eq!(place.renew(&Which::Due, day).machines, names(&["old"]));
    assert_eq!(place.renew(&Which::Due, day).machines, names(&[]));
    assert_eq!(place.renew(&Which::Due, day + 300 * DAY).machines, names(&["old"]));
}

#[test]
fn no_certificate_outlasts_that_of_its_authority() {
    let mut place = Place::new();
    let end = NOW + AUTHORITY_DAYS * DAY;
    let late = end - 10 * DAY;
    let robot = place.enroll("robot2", late);
    assert_eq!(robot.lifetime().ends, end);
    let Some(Notice::Soon(_, hint)) = robot.lifetime().notice(late) else { panic!() };
    assert!(hint.contains("make another authority"), "{hint}");
    assert_eq!(place.renew(&Which::Due, late).machines, names(&[]));
    assert_eq!(place.renew(&Which::All, late).ends, end);
    let failure = place.authority.renew(&Which::All, b"", end).unwrap_err();
    assert_eq!(failure.to_string(), "the certificate of the authority has ended on 2036-11-24");
    let (_, request) = authority::request("robot3").unwrap();
    assert!(place.authority.admit("robot3", false, &request, end).is_err());
}

#[test]
fn what_the_authority_has_not_signed_for_this_machine_is_refused() {
    let (mut place, mut other) = (Place::new(), Place::new());
    let robot = place.enroll("robot2", NOW);
    other.enroll("robot2", NOW + DAY);
    let later = NOW + 30 * DAY;
    place.renew(&Which::All, later);
    other.renew(&Which::All, later);
    let good = place.authority.certificates();
    // Of another authority, alone or beside a good one.
    let foreign = other.authority.certificates();
    for text in [foreign.clone(), format!("{good}{foreign}"), format!("{foreign}{good}")] {
        let refused = robot.news(text.as_bytes()).unwrap_err();
        assert!(refused.contains("the authority has not signed the certificate of robot2"));
    }
    // With one changed byte, wherever it is.
    let der = pem::parse(&good).unwrap().into_contents();
    for at in 0..der.len() {
        let mut changed = der.clone();
        changed[at] ^= 1;
        let text = pem::encode(&pem::Pem::new("CERTIFICATE", changed));
        // Nor is it of interest if that makes it one of a machine that is not on the roster, or that ends earlier.
        assert_eq!(robot.news(text.as_bytes()).unwrap_or_default(), Vec::new(), "{at}");
    }
    for text in ["-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n", "{}"] {
        assert!(robot.news(text.as_bytes()).is_err() || robot.news(text.as_bytes()) == Ok(vec![]));
    }
    assert!(robot.news(&vec![b' '; BUNDLE_LIMIT + 1]).is_err());
    // For a machine that was enrolled again: neither its old subject nor another key.
    let again = place.enroll("robot2", NOW);
    assert_eq!(again.news(good.as_bytes()), Ok(Vec::new()));
}

#[test]
fn a_certificate_for_another_key_or_another_use_is_refused() {
    let mut place = Place::new();
    let robot = place.enroll("robot2", NOW);
    let folder = place.authority.folder();
    let key = KeyPair::from_pem(&files::read(&folder.join("authority.key")).unwrap()).unwrap();
    let issuer = Issuer::from_ca_cert_pem(&place.authority.certificate, &key).unwrap();
    let mine = KeyPair::from_pem(&files::read(&robot.folder.join(KEY)).unwrap()).unwrap();
    let sign = |key: &KeyPair, change: &dyn Fn(&mut CertificateParams)| {
        let mut params = CertificateParams::default();
        params.distinguished_name.push(rcgen::DnType::CommonName, "robot2#1");
        change(&mut params);
        params.signed_by(key, &issuer).unwrap().pem()
    };
    let fine = robot.news(sign(&mine, &|_| ()).as_bytes()).unwrap();
    assert_eq!(fine.len(), 1);
    let foreign = KeyPair::generate().unwrap();
    assert_eq!(robot.news(sign(&foreign, &|_| ()).as_bytes()), Ok(Vec::new()));
    let an_authority = |params: &mut CertificateParams| {
        params.is_ca = IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
    };
    assert!(robot.news(sign(&mine, &an_authority).as_bytes()).is_err());
    let for_mail = |params: &mut CertificateParams| {
        params.extended_key_usages = vec![rcgen::ExtendedKeyUsagePurpose::EmailProtection];
    };
    assert!(robot.news(sign(&mine, &for_mail).as_bytes()).is_err());
    // Where nothing is known of the key, as in a folder that another machine is enrolled in at this moment.
    let bundle = robot.bundle.clone();
    *bundle.lock().unwrap() = Bundle::default();
    let news = robot.news(sign(&foreign, &|_| ()).as_bytes()).unwrap();
    robot.keep_certificates(news).unwrap();
    assert_eq!(read(&robot.folder).certificate, robot.certificate);
}

#[test]
fn bundles_become_the_same_in_whatever_order_they_meet() {
    let mut place = Place::new();
    let first = place.enroll("robot1", NOW);
    place.enroll("robot2", NOW);
    let old = place.authority.certificates();
    place.renew(&Which::All, NOW + 9 * DAY);
    let new = place.authority.certificates();
    let roster = &place.authority.roster;
    let met = |texts: &[&str]| {
        let mut bundle = Bundle::default();
        for text in texts {
            let news = bundle.news(text.as_bytes(), roster, &first.authority).unwrap();
            bundle.take(news);
        }
        bundle
    };
    let expected = met(&[&new]);
    assert_eq!(expected.text(), new);
    for texts in [[&*old, &*new], [&*new, &*old]] {
        assert_eq!(met(&texts), expected);
    }
    assert_eq!(met(&[&old, &new]).digest(), expected.digest());
    assert_ne!(met(&[&old]).digest(), expected.digest());
    let credentials = read(&first.folder);
    assert_eq!(credentials.certificates_beside(&credentials.digest()), None);
}

#[test]
fn the_certificates_of_all_machines_fit_in_a_bundle() {
    let mut place = Place::new();
    place.authority.roster.number = u64::MAX - 1;
    let robot = place.enroll(&"r".repeat(64), NOW + 9 * DAY);
    assert_eq!(robot.name().len(), 64);
    let longest = robot.certificate.pem().len() + 60;
    assert!(longest * MACHINES <= BUNDLE_LIMIT, "{longest}");
}
