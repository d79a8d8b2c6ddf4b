//! Arrays: in one piece, in place, in any order, and for other formats.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::common::{parts, read, refused, sent};
use hprm_codec::{Array, Dynamic, DynamicArray, Memory, Source, decode, encode};
use serde::{Deserialize, Serialize};

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
struct Frame {
    number: u64,
    image: Array<u8>,
    mask: Option<Array<bool>>,
}

/// The head of an array that has its elements in it.
fn array(dtype: &str, order: u8, shape: &[u8], elements: &[u8]) -> Vec<u8> {
    let mut head = vec![1, 13, dtype.len() as u8 + 1, 0];
    head.extend(dtype.as_bytes());
    head.push(order);
    head.push(shape.len() as u8);
    head.extend(shape);
    head.push(elements.len() as u8 * 2);
    head.extend(elements);
    head
}

#[test]
fn arrays_of_all_elements_return() {
    fn returns<T: hprm_codec::Element + std::fmt::Debug>(elements: Vec<T>) {
        let array = Array::from_shape_vec(&[1, elements.len()], elements).unwrap();
        assert_eq!(sent::<Array<T>>(&array), Ok(array.clone()));
        assert_eq!(sent::<Vec<Array<T>>>(&vec![array.clone()]), Ok(vec![array]));
    }
    returns(vec![true, false]);
    returns(vec![i8::MIN, 1]);
    returns(vec![i16::MIN, 1]);
    returns(vec![i32::MIN, 1]);
    returns(vec![i64::MIN, 1]);
    returns(vec![u8::MAX, 1]);
    returns(vec![u16::MAX, 1]);
    returns(vec![u32::MAX, 1]);
    returns(vec![u64::MAX, 1]);
    returns(vec![1.5_f32, -0.0]);
    returns(vec![1.5_f64, -0.0]);
    returns(vec![[1.5_f32, 2.0]]);
    returns(vec![[1.5_f64, 2.0]]);
    returns(Vec::<f64>::new());
}

#[test]
fn an_array_is_described_as_numpy_does() {
    let draft = encode(&Array::from_shape_vec(&[1, 2], vec![1_u16, 2]).unwrap()).unwrap();
    assert_eq!(draft.head, array("<u2", 0, &[1, 2], &[1, 0, 2, 0]));
}

#[test]
fn a_large_array_is_not_copied() {
    let image = Array::from_shape_vec(&[300, 400], vec![7_u8; 120_000]).unwrap();
    let frame = Frame { number: 1, image: image.clone(), mask: None };
    let draft = encode(&frame).unwrap();
    let [Source::Memory(memory)] = &draft.parts[..] else { panic!("{:?}", draft.parts) };
    assert_eq!(memory.bytes().as_ptr(), image.as_ptr());
    let received: Frame = decode(&draft.head, &parts(&draft)).unwrap();
    assert_eq!(received.image.as_ptr(), image.as_ptr());
    assert_eq!(received, frame);
}

#[test]
fn the_memory_of_an_array_is_found_again() {
    struct Loan(Vec<u8>);

    impl Memory for Loan {
        fn bytes(&self) -> &[u8] {
            &self.0
        }
    }

    let loan: Arc<dyn Memory> = Arc::new(Loan(vec![0; 80_000]));
    let array = Array::<f64>::from_memory(Arc::clone(&loan), &[10_000]).unwrap();
    let draft = encode(&(1, array)).unwrap();
    let Source::Memory(memory) = draft.parts[0].clone() else { panic!("{:?}", draft.parts) };
    assert!(memory.downcast_ref::<Vec<u8>>().is_none());
    assert_eq!(memory.downcast::<Loan>().unwrap().0.len(), 80_000);
    assert!(loan.downcast::<Vec<u8>>().is_err());
}

#[test]
fn an_array_that_occurs_twice_is_one_part() {
    let array = Array::from(vec![1.0_f64; 10_000]);
    let other = array.reshape(&[100, 100]).unwrap();
    let draft = encode(&(array.clone(), array.clone(), other.clone())).unwrap();
    assert_eq!(draft.parts.len(), 2);
    assert_eq!(decode(&draft.head, &parts(&draft)), Ok((array.clone(), array, other)));
}

#[test]
fn an_array_in_fortrans_order_is_brought_into_that_of_c() {
    let elements = [1, 4, 2, 5, 3, 6];
    let received: Array<u8> = read(&array("|u1", 1, &[2, 3], &elements)).unwrap();
    assert_eq!(
        (received.shape(), received.as_slice()),
        ([2, 3].as_slice(), [1, 2, 3, 4, 5, 6].as_slice())
    );
    let rows: Vec<Vec<u8>> = read(&array("|u1", 1, &[2, 3], &elements)).unwrap();
    assert_eq!(rows, [[1, 2, 3], [4, 5, 6]]);
    let cube: Array<u8> = read(&array("|u1", 1, &[2, 1, 3], &elements)).unwrap();
    assert_eq!(cube.as_slice(), [1, 2, 3, 4, 5, 6]);
}

#[test]
fn misaligned_memory_is_copied() {
    struct Odd(Vec<u64>);

    impl Memory for Odd {
        fn bytes(&self) -> &[u8] {
            &bytemuck::cast_slice(&self.0)[1..5]
        }
    }

    let odd = Arc::new(Odd(vec![u64::from_le_bytes([0, 1, 0, 2, 0, 0, 0, 0])]));
    let copied = Array::<u16>::from_memory(odd, &[2]).unwrap();
    assert_eq!(copied.as_slice(), [1, 2]);
}

#[test]
fn arrays_serve_where_lists_of_numbers_are_expected() {
    let numbers = Array::from(vec![1_i16, 2, 3]);
    assert_eq!(sent(&numbers), Ok(vec![1_u8, 2, 3]));
    assert_eq!(sent(&numbers), Ok(vec![1.0_f64, 2.0, 3.0]));
    assert_eq!(sent(&numbers), Ok((1_u8, 2_u8, 3_u8)));
    assert_eq!(sent(&vec![1.5, 2.0]), Ok(Array::from(vec![1.5_f32, 2.0])));
    assert_eq!(sent(&Array::from(vec![[1.0_f32, 2.0]])), Ok(vec![(1.0_f64, 2.0_f64)]));
    assert_eq!(
        sent::<Vec<u8>>(&Array::from(vec![1_i16, 300])).unwrap_err().to_string(),
        "`value[1]`: expected u8, found the int 300"
    );
    // A number of NumPy is an array without dimensions.
    let mut number = vec![1, 19, 21, 1];
    number.extend(&array("<f4", 0, &[], &1.5_f32.to_le_bytes())[1..]);
    assert_eq!(read(&number), Ok(1.5_f64));
    assert_eq!(read(&number), Ok(Some(1.5_f32)));
    assert_eq!(refused::<u8>(&number), "`value`: expected u8, found the float 1.5");
}

#[test]
fn errors_of_arrays_say_what_to_do() {
    let f8 = array("<f8", 0, &[1], &[0; 8]);
    assert_eq!(
        refused::<Array<f32>>(&f8),
        "`value`: expected an array of the dtype <f4, found one of the dtype <f8 (hint: send array.astype('<f4'), or \
         receive an Array<f64>)"
    );
    assert_eq!(
        refused::<Array<f64>>(&array(">f8", 0, &[1], &[0; 8])),
        "`value`: the elements of the array have the byte order of another machine: the dtype is >f8 (hint: send \
         array.astype('<f8'))"
    );
    assert_eq!(
        refused::<Array<i64>>(&array("<M8[ns]", 0, &[1], &[0; 8])),
        "`value`: Rust has no elements of the array's dtype <M8[ns] (hint: send array.view('i8'))"
    );
    assert_eq!(
        refused::<BTreeMap<String, f64>>(&f8),
        "`value`: expected a map, found a NumPy array of the shape [1] and the dtype <f8"
    );
    assert_eq!(
        refused::<Array<f64>>(&[1, 3, 2]),
        "`value`: expected an array of the dtype <f8, found the int 1"
    );
    let mut fields = f8.clone();
    fields[3] = 2;
    assert_eq!(
        refused::<Array<f64>>(&fields),
        "`value`: its elements have fields, which only Python reads (hint: send one array for each field)"
    );
}

#[test]
fn arrays_that_lie_are_malformed() {
    for head in [
        array("<f8", 0, &[2], &[0; 8]),
        array("<f8", 2, &[1], &[0; 8]),
        array("|u1", 0, &[1; 65], &[0]),
    ] {
        assert!(read::<Array<f64>>(&head).unwrap_err().is_malformed());
    }
}

/// The head of an array without elements: so many long dimensions, then one of no length.
fn empty(dimensions: u8, length: &[u8], order: u8) -> Vec<u8> {
    let mut head = vec![1, 13, 4, 0, b'|', b'u', b'1', order, dimensions + 1];
    (0..dimensions).for_each(|_| head.extend(length));
    head.extend([0, 0]);
    head
}

#[test]
fn rows_without_elements_are_no_way_to_ask_for_memory() {
    let long = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f];
    for (dimensions, length) in [(1, &long[..]), (3, &long[..]), (4, &[0xff, 1][..])] {
        for order in [0, 1] {
            let head = empty(dimensions, length, order);
            assert!(read::<Vec<Vec<Vec<u8>>>>(&head).unwrap_err().is_malformed());
            assert_eq!(read::<Array<u8>>(&head).unwrap().len(), 0);
            assert_eq!(read::<Vec<u8>>(&empty(0, &[], order)), Ok(vec![]));
            assert_eq!(read(&empty(2, &[2], order)), Ok([[[0_u8; 0]; 2]; 2]));
        }
    }
}

#[test]
fn an_array_of_another_shape_shares_the_elements_and_copies_them_only_if_it_must() {
    let array = Array::filled(&[2, 3], 7_u16);
    let address = array.as_ptr();
    let mut other = array.reshape(&[6]).unwrap().reshape(&[3, 2]).unwrap();
    assert_eq!((other.as_ptr(), other.shape()), (address, [3, 2].as_slice()));
    // The first one has them, too.
    other.to_mut()[0] = 1;
    assert_ne!(other.as_ptr(), address);
    assert_eq!((array[0], other.shape()), (7, [3, 2].as_slice()));
    let mut last = array.reshape(&[1, 6]).unwrap();
    drop(array);
    last.to_mut()[0] = 1;
    assert_eq!(
        (last.as_ptr(), last.get(&[0, 0]), last.shape()),
        (address, Some(&1), [1, 6].as_slice())
    );
    let flat = last.reshape(&[6]).unwrap();
    drop(last);
    let elements = flat.into_vec();
    assert_eq!(elements.as_ptr(), address);
}

#[test]
fn an_array_changes_as_a_vector_does() {
    let mut array = Array::filled(&[2, 2], 0_u8);
    let kept = array.clone();
    array.to_mut()[3] = 1;
    assert_eq!((array.get(&[1, 1]), kept.get(&[1, 1])), (Some(&1), Some(&0)));
    assert_eq!((array.get(&[1]), array.get(&[2, 0])), (None, None));
    let address = array.as_ptr();
    array.to_mut()[0] = 2;
    assert_eq!(array.as_ptr(), address);
    assert_eq!(array.into_vec(), [2, 0, 0, 1]);
    assert!(kept.reshape(&[3]).is_err());
    assert_eq!(
        Array::from_shape_vec(&[3], vec![1_u16]).unwrap_err().to_string(),
        "the shape [3] of elements of 2 bytes each does not fit 1 elements"
    );
    assert_eq!(
        Array::<u16>::from_memory(Arc::new(vec![0; 5]), &[2]).unwrap_err().to_string(),
        "the shape [2] of elements of 2 bytes each does not fit 5 bytes"
    );
    assert_eq!(format!("{:?}", Array::from(vec![1_u8, 2])), "Array<u8>[2] [1, 2]");
}

#[test]
fn other_formats_see_shape_and_elements() {
    let frame = Frame { number: 3, image: Array::from(vec![1, 2]), mask: None };
    let text = serde_json::to_string(&frame).unwrap();
    assert_eq!(text, r#"{"number":3,"image":{"shape":[2],"data":[1,2]},"mask":null}"#);
    assert_eq!(serde_json::from_str::<Frame>(&text).unwrap(), frame);
    assert!(serde_json::from_str::<Array<u8>>(r#"{"shape":[3],"data":[1,2]}"#).is_err());
    // And formats that do not describe themselves.
    let bytes = postcard::to_allocvec(&frame).unwrap();
    assert_eq!(postcard::from_bytes::<Frame>(&bytes).unwrap(), frame);
    // Nothing is left over for the next value.
    assert_eq!(sent(&1_u8), Ok(1_u8));
}

#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum Either {
    Text(String),
    Grid(Array<i32>),
}

#[test]
fn an_array_passes_where_serde_keeps_a_value_for_later() {
    let grid = Either::Grid(Array::from_shape_vec(&[2, 2], vec![1, 2, 3, 4]).unwrap());
    assert_eq!(sent(&grid), Ok(grid));
    let row = Either::Grid(Array::from(vec![1, 2]));
    assert_eq!(sent(&row), Ok(row));
    let text = Either::Text("grid".into());
    assert_eq!(sent(&text), Ok(text));
}

#[test]
fn a_dynamic_value_keeps_arrays_and_tuples() {
    let array = Array::from_shape_vec(&[1, 2], vec![1_u8, 2]).unwrap();
    let value = Dynamic::Dict(vec![
        (Dynamic::Str("a".into()), Dynamic::Array(array.clone().into())),
        (Dynamic::Int(1), Dynamic::Tuple(vec![Dynamic::None, Dynamic::List(vec![])])),
    ]);
    assert_eq!(sent(&value), Ok(value.clone()));
    assert_eq!(value.get("a"), Some(&Dynamic::Array(DynamicArray::U8(array))));
    assert_eq!(
        sent::<Dynamic>(&(1, vec![2.0])),
        Ok(Dynamic::Tuple(vec![Dynamic::Int(1), Dynamic::List(vec![Dynamic::Float(2.0)]),]))
    );
}
