"""Who waits for whom in one area, and why: looked up in what traffic holds, deciding nothing."""

from ledger.waits import Wait, WaitReason

__all__ = ["Wait", "WaitReason"]
