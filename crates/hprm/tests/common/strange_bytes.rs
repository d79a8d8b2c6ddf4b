//! A handshake with any process ends, in bounded memory, and succeeds only with a process that knows the
//! secret. Shared with the fuzz target in `fuzz/`.

use hprm_federated::FederationId;

use crate::proof::{Handshake, LONGEST, Purpose, Role};

/// Plays the other end of a handshake with `bytes`, in pieces of varying lengths, in either role. None
/// of them is a proof: the secret is not in them.
pub(crate) fn strange_bytes(bytes: &[u8]) {
    let Some((first, bytes)) = bytes.split_first() else { return };
    for role in [Role::Opener, Role::Acceptor] {
        let secret = FederationId(0x5ec2_e7f0_12ab_34cd_0987_6543_21fe_dcba);
        let mut handshake = Handshake::new(secret, role, Purpose::Messages, [*first; 32]);
        let mut rest = bytes;
        let mut said = 0;
        loop {
            said += handshake.outbound().len();
            handshake.sent(handshake.outbound().len());
            assert!(!handshake.is_over(), "a process without the secret has proved it");
            assert!(said <= 3 * LONGEST, "a handshake says little");
            let wanted = handshake.wanted();
            assert!(wanted <= LONGEST);
            let size = wanted.min(rest.len()).min(1 + usize::from(*first) % LONGEST);
            if size == 0 {
                break;
            }
            let (piece, after) = rest.split_at(size);
            rest = after;
            if handshake.take(piece, || vec![*first; 3]).is_err() {
                break;
            }
        }
        // A refusal is the last thing that it says.
        handshake.sent(handshake.outbound().len());
        assert!(!handshake.is_over());
    }
}
