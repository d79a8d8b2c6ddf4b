//! An executable that is one federate of a federation described elsewhere: in an `.lf` file, or in Python.

use std::sync::Arc;

use hprm_codec::Transfer;
use hprm_core::{PortId, Properties, ReactorId, StoreOptions};
use serde::de::DeserializeOwned;

use super::builder::{Reactor, ReactorBuilder};
use super::describe;
use super::graph::Graph;
use super::handed::Handed;
use super::handle::{InputPort, OutputPort, Slotted};
use super::identity::Of;
use super::parameter_names;
use super::parameters::{self, Mistake};
use super::parts::Parts;
use super::running::run_federate;
use super::transport::Codec;
use crate::handover::Handover;
use crate::{Failure, Kind, Report, describing};

/// The ports of a reactor that other federates can be connected to: their values can travel.
///
/// Ports have it if their values are [`Transfer`], and so have tuples, arrays and vectors of them. A type of your own
/// names its ports:
///
/// ```
/// use hprm::prelude::*;
///
/// struct CameraPorts {
///     image: OutputPort<Array<u8>>,
///     exposure: InputPort<f64>,
/// }
///
/// impl Interface for CameraPorts {
///     fn each(&self, add: &mut dyn FnMut(&dyn Interface)) {
///         add(&self.image);
///         add(&self.exposure);
///     }
/// }
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not say how the values of its ports travel",
    note = "`Reactor::Ports` of a reactor that is a federate is a port whose values are `Transfer`, a tuple, an array or a \
            vector of those, or a type of your own that implements `hprm::Interface`"
)]
pub trait Interface {
    /// Calls `add` with each port, or with each group of them.
    fn each(&self, add: &mut dyn FnMut(&dyn Interface));

    /// The port that this is, if it is one.
    #[doc(hidden)]
    fn port(&self) -> Option<CarriedPort> {
        None
    }
}

/// A port, and how its values travel.
#[doc(hidden)]
pub struct CarriedPort(Of<PortId>, Codec);

macro_rules! ports {
    ($($name:ident)*) => {$(
        impl<T: Transfer> Interface for $name<T> {
            fn each(&self, _: &mut dyn FnMut(&dyn Interface)) {}

            fn port(&self) -> Option<CarriedPort> {
                Some(CarriedPort(self.slot().port()?, Codec::of::<T>()))
            }
        }
    )*};
}

ports! { InputPort OutputPort }

impl Interface for () {
    fn each(&self, _: &mut dyn FnMut(&dyn Interface)) {}
}

impl<I: Interface> Interface for Vec<I> {
    fn each(&self, add: &mut dyn FnMut(&dyn Interface)) {
        self.iter().for_each(|one| add(one));
    }
}

impl<I: Interface, const N: usize> Interface for [I; N] {
    fn each(&self, add: &mut dyn FnMut(&dyn Interface)) {
        self.iter().for_each(|one| add(one));
    }
}

macro_rules! tuples {
    ($(($($name:ident)+))*) => {$(
        impl<$($name: Interface),+> Interface for ($($name,)+) {
            fn each(&self, add: &mut dyn FnMut(&dyn Interface)) {
                #[allow(non_snake_case, reason = "types and values have one name")]
                let ($($name,)+) = self;
                $(add($name);)+
            }
        }
    )*};
}

tuples! { (A) (A B) (A B C) (A B C D) (A B C D E) (A B C D E F) (A B C D E F G) (A B C D E F G H) }

/// Makes this process a federate of a program that is described elsewhere: in an `.lf` file or in Python, where a
/// reactor names this executable. `name` is the name of that reactor, and `reactor` what it is made of.
///
/// Whatever asks what the executable declares, and each federate that it is, runs `main` up to here, so what comes
/// before should do nothing that takes long or changes something. Neither of them returns.
///
/// ```no_run
/// use hprm::prelude::*;
///
/// struct Camera;
///
/// impl Reactor for Camera {
///     type Ports = OutputPort<Array<u8>>;
///
///     fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
///         let image = camera.output("image");
///         camera.reaction().on(Startup).sets(image).run(move |_, ctx| {
///             ctx.set(image, Array::filled(&[480, 640], 7));
///         });
///         image
///     }
/// }
///
/// fn main() -> Result<(), Failure> {
///     run_as_federate("Camera", Camera)
/// }
/// ```
///
/// # Errors
///
/// If this process was not started as a federate, or the reactor breaks a rule.
pub fn run_as_federate<R: Reactor>(name: &str, reactor: R) -> Result<(), Failure>
where
    R::Ports: Interface,
{
    run_as_federate_with(name, |()| reactor)
}

/// Like [`run_as_federate`], for a reactor with parameters: `make` makes it of those that the program states. They are
/// a type that derives serde's `Deserialize`, in most cases a struct whose fields are the parameters.
///
/// In an `.lf` file they are the parameters of the reactor, in Python those of its constructor. A time is a
/// [`Duration`](std::time::Duration); docs/reference/codec.md says which other types
/// fit. A parameter that the program does not have, and the type needs, is an error of `hprm check`, as is
/// one that the type does not have, and one of another type.
///
/// Whatever asks what the executable declares does so with the parameters of each federate, so timers, ports inside and
/// all else may follow from them.
///
/// ```no_run
/// use std::time::Duration;
///
/// use hprm::prelude::*;
/// use serde::Deserialize;
///
/// /// `reactor Camera(rate = 10)` in an `.lf` file.
/// #[derive(Deserialize)]
/// struct Camera {
///     rate: u32,
/// }
///
/// impl Reactor for Camera {
///     type Ports = OutputPort<u32>;
///
///     fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
///         let number = camera.output("number");
///         let tick = camera.timer("tick", Duration::ZERO, Duration::from_secs(1) / self.rate);
///         let mut taken = 0;
///         camera.reaction().on(tick).sets(number).run(move |_, ctx| {
///             taken += 1;
///             ctx.set(number, taken);
///         });
///         number
///     }
/// }
///
/// fn main() -> Result<(), Failure> {
///     run_as_federate_with("Camera", |camera: Camera| camera)
/// }
/// ```
///
/// # Errors
///
/// If this process was not started as a federate, or the reactor breaks a rule.
pub fn run_as_federate_with<P: DeserializeOwned, R: Reactor>(
    name: &str,
    make: impl FnOnce(P) -> R,
) -> Result<(), Failure>
where
    R::Ports: Interface,
{
    let handover = Handover::of_this_process()?;
    let given = match &handover {
        None => describing::given()?,
        Some(handover) => handover.parameters.clone(),
    };
    let known = || {
        let names = given.iter().map(|(name, _)| (name.clone(), String::new()));
        parameter_names::of::<P>().unwrap_or_else(|| names.collect())
    };
    let mut reactor = match (parameters::read(&given).map(make), &handover) {
        (Ok(reactor), _) => reactor,
        (Err(mistake), Some(handover)) => run_federate(handover, Err(other_parameters(&mistake))),
        (Err(mistake), None) => {
            describe::refuse(&mistake, &known())?;
            return Err(alone(name));
        }
    };
    let mut graph = match &handover {
        None => Graph::new(name),
        Some(handover) => handed(handover),
    };
    let root = graph.parts.root();
    let ports = reactor.assemble(&mut ReactorBuilder::new(&mut graph, root));
    graph.bodies.insert(root, Box::new(reactor));
    collect(&ports, &mut graph);
    let built = graph.build(Properties::default());
    if let Some(handover) = handover {
        run_federate(&handover, built);
    }
    let (program, bodies, _) = built?;
    let own = program.ports.iter().filter(|(_, port)| port.reactor == root);
    let stray = own.filter(|(id, _)| !bodies.carries(*id)).map(|(id, _)| id);
    let mistakes: Vec<_> = stray.map(|port| untyped(&program.port_name(port))).collect();
    if !mistakes.is_empty() {
        return Err(Failure::Mistakes(mistakes));
    }
    describe::answer(&program, StoreOptions::default(), &known())?;
    Err(alone(name))
}

/// The program that this process was handed.
fn handed(handover: &Handover) -> Graph {
    let program = Arc::new(handover.program.clone());
    let federate = program.federate_named(&handover.federate);
    let root = federate.map(|federate| program.federates[federate].reactor);
    Graph::of(Parts::Handed(Handed::new(program, root.unwrap_or(ReactorId(0)))))
}

/// The executable took its parameters when it was asked, and does not take them now.
fn other_parameters(mistake: &Mistake) -> Failure {
    let what = format!("this executable does not take its parameters any more: {mistake}");
    Failure::Mistakes(vec![
        Report::new(Kind::Program, what)
            .hint("it was built again after the launcher had asked it; run the program again"),
    ])
}

fn collect(ports: &dyn Interface, graph: &mut Graph) {
    if let Some(CarriedPort(port, codec)) = ports.port() {
        graph.carry(port, codec);
    }
    ports.each(&mut |inner| collect(inner, graph));
}

fn untyped(port: &str) -> Report {
    Report::new(Kind::Program, format!("nothing says how the values of port {port} travel"))
        .hint("`Reactor::Ports` has to contain all ports of the reactor: return it from `assemble`")
}

fn alone(name: &str) -> Failure {
    Failure::Option {
        message: format!("{name} is a federate of a program that is described elsewhere"),
        hint: Some(
            "name this executable in a program, and start that: `@executable(\"PATH\")` above a reactor in an .lf \
             file, `class NAME(hprm.Reactor, executable=\"PATH\")` in Python",
        ),
    }
}
