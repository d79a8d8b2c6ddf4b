//! A camera, a detector and a controller: values of many types, large arrays that are read in place among them.

use std::collections::BTreeMap;
use std::time::Duration;

use hprm::prelude::*;
use serde::{Deserialize, Serialize};

const MS: Duration = Duration::from_millis(1);

/// 8 MB.
const SHAPE: [usize; 3] = [2_000, 1_000, 4];

const ROUNDS: u64 = 10;

/// An image, and what is known about it.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub(crate) struct Frame {
    number: u64,
    exposure: Option<f64>,
    name: String,
    pixels: Array<u8>,
    tags: BTreeMap<String, (i32, bool)>,
    shutter: Shutter,
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub(crate) enum Shutter {
    Closed,
    Open { micros: u32 },
}

/// Whether elements lie in an object store, as seen by the system; true in a process that has none.
fn lies_in_a_store(elements: &[u8]) -> bool {
    let address = elements.as_ptr() as usize;
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let lies = maps.lines().filter(|line| line.contains("/memfd:")).any(|line| {
        let (start, rest) = line.split_once('-').unwrap();
        let end = rest.split(' ').next().unwrap();
        let [start, end] = [start, end].map(|text| usize::from_str_radix(text, 16).unwrap());
        (start..end).contains(&address)
    });
    lies || std::env::var_os("HPRM_HANDOVER").is_none()
}

fn frame(number: u64, pixels: Array<u8>) -> Frame {
    Frame {
        number,
        exposure: (number.is_multiple_of(2)).then_some(0.25),
        name: format!("frame {number}, größer"),
        pixels,
        tags: [("left".to_owned(), (-3, true))].into(),
        shutter: if number.is_multiple_of(3) {
            Shutter::Closed
        } else {
            Shutter::Open { micros: 125 }
        },
    }
}

pub(crate) struct Camera;

impl Reactor for Camera {
    type Ports = (OutputPort<Frame>, OutputPort<Array<u8>>, OutputPort<u64>);

    fn assemble(&mut self, camera: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let ports = (camera.output("frame"), camera.output("pixels"), camera.output("count"));
        let tick = camera.timer("tick", Duration::ZERO, MS);
        let mut round = 0;
        camera.reaction().on(tick).sets(ports.0).sets(ports.1).sets(ports.2).run(move |_, ctx| {
            let mut pixels = ctx.loan::<u8>(&SHAPE);
            pixels.fill(round as u8);
            let pixels = Array::from(pixels);
            assert!(lies_in_a_store(&pixels));
            ctx.set(ports.0, frame(round, pixels.clone()));
            ctx.set(ports.1, pixels);
            ctx.set(ports.2, round);
            round += 1;
        });
        ports
    }
}

/// Sends on what it gets, and counts what is as it should be.
struct Detector;

impl Reactor for Detector {
    type Ports =
        (InputPort<Frame>, InputPort<Array<u8>>, OutputPort<Frame>, OutputPort<Array<f32>>);

    fn assemble(&mut self, detector: &mut ReactorBuilder<'_, Self>) -> Self::Ports {
        let (frame, pixels) =
            (detector.input::<Frame>("frame"), detector.input::<Array<u8>>("pixels"));
        let (out, scaled) = (detector.output("out"), detector.output("scaled"));
        detector.reaction().on([pixels]).reads(frame).sets(out).sets(scaled).run(move |_, ctx| {
            let (Some(frame), Some(pixels)) = (ctx.get(frame).cloned(), ctx.get(pixels).cloned())
            else {
                return;
            };
            assert_eq!(frame.pixels, pixels);
            assert!(lies_in_a_store(&frame.pixels) && lies_in_a_store(&pixels));
            let all = pixels.iter().take(100_000).map(|pixel| f32::from(*pixel) / 2.0).collect();
            ctx.set(scaled, Array::from_shape_vec(&[100, 1_000], all).unwrap());
            ctx.set(out, frame);
        });
        (frame, pixels, out, scaled)
    }
}

pub(crate) fn values(federation: Federation) -> Federation {
    let mut federation = federation.timeout(MS * (ROUNDS as u32 - 1));
    let (frames, pixels, count) = federation.add("camera", Camera);
    let (inp, pixels_in, out, scaled) = federation.add("detector", Detector);
    federation.connect(frames, inp);
    federation.connect(pixels, pixels_in);
    let (seen, seen_scaled, counted) = federation.reactor("controller", 0, |controller| {
        let seen = controller.input::<Frame>("frame");
        let (scaled, count) =
            (controller.input::<Array<f32>>("scaled"), controller.input::<u64>("count"));
        controller.reaction().on(seen).reads(scaled).reads(count).run(move |right, ctx| {
            let Some(number) = ctx.get(count).copied() else { return };
            let pixels = Array::filled(&SHAPE, number as u8);
            *right += u32::from(ctx.get(seen) == Some(&frame(number, pixels)));
            let half = Array::filled(&[100, 1_000], number as f32 / 2.0);
            *right += u32::from(ctx.get(scaled) == Some(&half));
            *right += u32::from(u128::from(number) * 1_000_000 == ctx.elapsed().as_nanos());
        });
        controller
            .reaction()
            .on(Shutdown)
            .run(|right, _| println!("{right} values arrived as they were sent"));
        (seen, scaled, count)
    });
    federation.connect(out, seen);
    federation.connect(scaled, seen_scaled);
    federation.connect(count, counted);
    federation
}
